"""Better frequencies for the calibration of one LISA spacecraft, as a campaign to run."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fit.files import atomic
from fit.settings import settings
from fit.tables import Table
from lpfcosim.campaign import Campaign, loading
from lpfcosim.errors import InputError
from lpfcosim.execution import validation
from lpfcosim.experiment_design import (
    TONES,
    LocalDesign,
    design_local_tones,
    extending_text,
    written_injections,
)
from lpfcosim.spacecraft import Sine
from lpfcosim.workflows.progress import Progress
from lpfcosim.workflows.result import WorkflowResult, by_parameter

SCHEMA = "lpf-design/1"
HEAD = ("parameter", "sigma", "designed", "ratio", "ratio bound")
HERTZ = 1e3  # mHz


@dataclass(frozen=True, repr=False)
class SpacecraftDesign(WorkflowResult):
    """A designed calibration of one LISA spacecraft.

    Attributes
    ----------
    design : LocalDesign
        Tones, sigmas before and after, and bounds.
    path : Path
        The file of the campaign.
    """

    design: LocalDesign
    path: Path

    def records(self) -> list[dict[str, Any]]:
        """Return a row for each parameter."""
        d = self.design
        return [
            {
                "parameter": name,
                "sigma_before": d.before[name].sigma,
                "sigma_after": d.after[name].sigma,
                "sigma_bound": d.sigma_bounds[name],
            }
            for name in d.parameters
        ]

    def table(self) -> Table:
        """Return the sigmas before and after, and the bound relative to that before."""
        rows = [
            (name, f"{before:.2g}", f"{after:.2g}", f"{after / before:.3f}", f"{bound / before:.3f}")
            for name, before, after, bound in (row.values() for row in self.records())
        ]
        return Table(HEAD, tuple(rows))

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-design/1``."""
        d = self.design
        return {
            "schema": SCHEMA,
            "parameters": by_parameter(self.records()),
            "objective": {"value": d.value, "bound": d.bound},
            "limits": {
                experiment.name: {
                    f"{into} frequency": {"limit": limit, "reached": reached}
                    for into, limit in d.max_frequencies.items()
                    if (reached := _highest(experiment.injections, into))
                }
                for experiment in d.campaign.experiments
            },
            "efficiency": d.bound / d.value,
        }

    def summary(self) -> Iterator[str]:
        """Yield a sentence about objective and bound."""
        d = self.design
        if d.value >= 1:
            yield "no better frequencies were found; those of the campaign remain"
        yield (
            f"geometric mean of the ratios: {d.value:.4f}; with the other parameters known and each tone at "
            f"its best frequency: {d.bound:.4f}"
        )


def design_spacecraft(
    source: Path | None, plan: Campaign, path: Path, progress: Progress
) -> SpacecraftDesign:
    """Find better frequencies for the tones of a campaign, and write it.

    Raises
    ------
    InputError
        If no tone of the campaign moves a test mass, it sweeps, or it was not read from a file.
    """
    if source is None:
        raise InputError("design: a campaign of LISA in memory, expected the path of its file")
    validation.check_linear_model(plan, "a design is")
    if "sweep" in plan.tables:
        raise InputError("sweep: not available for a design of LISA, write its experiments instead")
    for doubt in validation.validate(plan).doubts:
        progress.warn(doubt)
    with progress.stage("search"):
        found = design_local_tones(plan, settings(plan.fit, "fit"))
    result = SpacecraftDesign(found, path)
    atomic.write(path, extending_text(path, source, result.summary(), _tables(found)))
    loading.load(path)
    return result


def _highest(injections: tuple[object, ...], into: str) -> float:
    """Return the highest frequency of the sines into a set point [Hz], 0 without any."""
    return max((i.frequency for i in injections if isinstance(i, Sine) and i.into == into), default=0.0)


def _tables(design: LocalDesign) -> Iterator[dict[str, Any]]:
    """Yield the experiments of the campaign file, as they were written but for the frequencies."""
    tables = design.plan.tables
    after = {experiment.name: experiment for experiment in design.campaign.experiments}
    for written in tables["experiments"]:
        sines = iter(i for i in after[written["name"]].injections if isinstance(i, Sine))
        changed = [
            _retuned(i, next(sines)) if i["shape"] in TONES else i
            for i in written_injections(tables, written)
        ]
        yield {**written, "sequences": [], "injections": changed}


def _retuned(injection: Mapping[str, Any], sine: Sine) -> dict[str, Any]:
    return {**injection, "frequency": f"{HERTZ * sine.frequency:.12g} mHz", "cycles": sine.cycles}
