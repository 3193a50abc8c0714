"""The manoeuvre that calibrates tilt-to-length coupling in the least time, as a campaign to run."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic_core import PydanticCustomError

from fit.errors import shown
from fit.files import atomic
from fit.settings import settings
from fit.tables import Table
from lpfcosim.campaign import loading, names, units
from lpfcosim.errors import InputError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.experiment_design import Manoeuvre, extending_text, is_design
from lpfcosim.experiment_design import design_manoeuvre as find_manoeuvre
from lpfcosim.planned_experiments import LISA
from lpfcosim.spacecraft import FS, TaperedSine
from lpfcosim.workflows.arguments import check_options
from lpfcosim.workflows.campaigns import PathLike, as_path
from lpfcosim.workflows.output_paths import check_file
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.result import WorkflowResult, by_parameter

SCHEMA = "lpf-manoeuvre/1"
HEAD = ("coefficient", "sigma [um/rad]", "designed", "bound")
MICRO, NANO, HOUR, MINUTE = 1e6, 1e9, 3600.0, 60.0


@dataclass(frozen=True, repr=False)
class ManoeuvreDesign(WorkflowResult):
    """A designed manoeuvre.

    Attributes
    ----------
    manoeuvre : Manoeuvre
        Tones, sigmas before and after, and bounds.
    target : float
        Sigma that none exceeds [m/rad].
    path : Path
        The file of the campaign.
    """

    manoeuvre: Manoeuvre
    target: float
    path: Path

    def records(self) -> list[dict[str, Any]]:
        """Return a row for each coefficient."""
        m = self.manoeuvre
        return [
            {
                "parameter": name,
                "sigma_before": m.sigmas_before[name],
                "sigma_after": m.sigmas_after[name],
                "sigma_bound": m.sigma_bounds[name],
            }
            for name in m.sigmas_after
        ]

    def table(self) -> Table:
        """Return the sigmas before and after."""
        rows = [
            (record["parameter"], *(f"{MICRO * x:.1f}" for x in list(record.values())[1:]))
            for record in self.records()
        ]
        return Table(HEAD, tuple(rows))

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-manoeuvre/1``."""
        m = self.manoeuvre
        return {
            "schema": SCHEMA,
            "parameters": by_parameter(self.records()),
            "objective": {"target": self.target, "value": max(m.sigmas_after.values())},
            "limits": {
                experiment: {
                    f"{into} peak": {"limit": limit, "reached": m.motion_reached[experiment][into]}
                    for into, limit in limits.items()
                }
                for experiment, limits in m.motion_limits.items()
            },
            "efficiency": m.min_duration / m.duration,
            "hours": m.duration / HOUR,
            "hours_before": m.duration_before / HOUR if m.duration_before < float("inf") else None,
            "hours_bound": m.min_duration / HOUR,
        }

    def summary(self) -> Iterator[str]:
        """Yield sentences about duration and bound."""
        m = self.manoeuvre
        minutes = [x / MINUTE for x in (m.duration, m.min_duration, m.duration_before)]
        yield (
            f"{minutes[0]:.1f} min for at most {MICRO * self.target:g} um/rad, delays included; no tones of "
            f"the same amplitudes do it in less than {minutes[1]:.1f} min"
        )
        if m.duration_before < float("inf"):
            yield f"the tones of the campaign would take {minutes[2]:.1f} min"
        else:
            yield "the tones of the campaign do not determine all coefficients"


def design_manoeuvre(
    campaign: PathLike,
    out: PathLike | None = None,
    *,
    sigma: float | str = 1e-5,
    progress: Progress = LOG,
) -> ManoeuvreDesign:
    """Find the manoeuvre of three LISA spacecraft that reaches a sigma in the least time; write its campaign.

    The amplitudes of the sines of the campaign limit the motion about theta, eta, phi and of the opening;
    frequencies and duration are free.

    Parameters
    ----------
    campaign : path
        Three experiments, spacecraft 1, 2 and 3.
    out : path, optional
        The file to write, which must end in ``.toml``; by default ``NAME-designed.toml``.
    sigma : float or str
        That no coefficient exceeds, in m/rad, or with its unit: ``"10 um/rad"``.
    progress : Progress, optional
        By default warnings are logged.

    Raises
    ------
    InputError
        If the campaign is no manoeuvre of three LISA spacecraft, sigma is not reached within two days, or the
        file exists and is no earlier design.
    """
    source = as_path(campaign, "a campaign file")
    plan = loading.load(source)
    path = Path(f"{source.stem}-designed.toml") if out is None else as_path(out, "the path of a file")
    check_file(path, loading.sources(source), [".toml"])
    names.check_stem(path)
    if path.is_file() and not is_design(path):
        raise InputError(f"{path}: is there already and is no design, expected a new name")
    target = _target(sigma)
    check_options(progress)
    with prefix_errors(source):
        settings(plan.fit, "fit")
        validation.check_linear_model(plan, "a design is")
        validation.check_equation(plan, "a manoeuvre for tilt-to-length coupling is", LISA)
        if "sweep" in plan.tables:
            raise InputError("sweep: not available for a manoeuvre, write its three experiments instead")
        with progress.stage("search"):
            manoeuvre = find_manoeuvre(plan, target)
    design = ManoeuvreDesign(manoeuvre, target, path)
    atomic.write(path, extending_text(path, source, design.summary(), _tables(manoeuvre)))
    loading.load(path)
    return design


def _target(sigma: object) -> float:
    """Return a sigma in m/rad."""
    quantity = units.LENGTH_PER_ANGLE
    if isinstance(sigma, str):
        try:
            return quantity.to_si(sigma)
        except PydanticCustomError as error:
            raise InputError(f"sigma: {error}") from None
    if isinstance(sigma, bool) or not isinstance(sigma, int | float) or not sigma > 0:
        raise InputError(
            f"sigma: {shown(sigma)}, expected a positive number in m/rad such as 1e-5, or one with its unit "
            f'such as "{quantity.example}"'
        )
    if not quantity.smallest <= sigma <= quantity.largest:
        raise InputError(f"sigma: {sigma:g} m/rad, expected {quantity.smallest:g} to {quantity.largest:g}")
    return float(sigma)


def _tables(manoeuvre: Manoeuvre) -> Iterator[dict[str, Any]]:
    """Yield the experiments of the campaign file."""
    written = manoeuvre.plan.tables["experiments"]
    for experiment, before in zip(manoeuvre.campaign.experiments, written, strict=True):
        table = {key: value for key, value in before.items() if key not in ("sequences", "injections")}
        if experiment.name in manoeuvre.tones:
            table["duration"] = f"{experiment.n_samples / FS:.12g} s"
            table["injections"] = [_injection(i) for i in experiment.injections if isinstance(i, TaperedSine)]
        yield table


def _injection(tone: TaperedSine) -> dict[str, object]:
    return {
        "into": tone.into,
        "shape": "tapered_sine",
        "frequency": f"{1e3 * tone.frequency:.12g} mHz",
        "amplitude": f"{NANO * tone.amplitude:.6g} nrad",
        "cycles": tone.cycles,
        "start": f"{tone.start:.12g} s",
        "ramp": f"{tone.ramp:.12g} s",
    }
