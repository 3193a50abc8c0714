"""The best injections of a campaign within limits, checked through the FMUs, as a campaign to run."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fit.files import atomic
from fit.parallel import one_blas_thread, update_progress
from fit.settings import settings
from fit.tables import Table
from lpfcosim.campaign import Campaign, loading, names
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.experiment_design import (
    Design,
    FitModel,
    Robustness,
    SearchProgress,
    campaign_text,
    information_spectrum,
    is_design,
    robustness,
)
from lpfcosim.experiment_design import design as find_design
from lpfcosim.models import DELTA_G
from lpfcosim.workflows.arguments import check_options, check_workers
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_path, is_described_by_file, resolve
from lpfcosim.workflows.design_check import TOLERANCE, LimitRatios, verify_in_time_domain
from lpfcosim.workflows.output_paths import check_file
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.result import WorkflowResult

SCHEMA = "lpf-design/1"
HEAD = ("parameter", "sigma", "designed", "ratio", "ratio at best, alone")
HOUR = 3600.0
MIN_BOUND_RATIO = 0.98  # of the bound, below which a forecast proves a mistake; both are right to 1 %
GRID = (4e-4, 0.095, 300)  # Hz, from, to, and number of frequencies of the figure


@dataclass(frozen=True, repr=False)
class CampaignDesign(WorkflowResult):
    """A designed campaign.

    Attributes
    ----------
    design : Design
        Tones, sigmas before and after, and the bound.
    path : Path
        The file of the campaign.
    limits_reached : mapping
        By experiment and limit, what its runs reach through the FMUs, in units of the limit.
    robustness : Robustness or None
        With other truths and noise; None if the search was interrupted.
    dropped : tuple of str
        Experiments that are not needed.
    """

    design: Design
    path: Path
    limits_reached: LimitRatios
    robustness: Robustness | None
    dropped: tuple[str, ...]

    def records(self) -> list[dict[str, Any]]:
        """Return a row for each parameter, NaN where there is no number."""
        nan, design_result = float("nan"), self.design
        rows = [
            (
                name,
                design_result.problem.sigmas_before[name],
                design_result.sigmas_after.get(name, nan),
                design_result.sigma_bounds.get(name, nan),
            )
            for name in design_result.problem.parameters
        ]
        if design_result.angles:
            rows += [
                (name, design_result.angles.sigmas_before[name], design_result.angles.sigmas_after[name], nan)
                for name in design_result.angles.target_sigmas
            ]
        columns = ("parameter", "sigma_before", "sigma_after", "sigma_bound")
        return [dict(zip(columns, row, strict=True)) for row in rows]

    def table(self) -> Table:
        """Return the sigmas before and after."""

        def optional(number: float, form: str) -> str:
            return format(number, form) if number == number else ""

        rows = [
            (
                record["parameter"],
                f"{record['sigma_before']:.2g}",
                optional(record["sigma_after"], ".2g"),
                optional(record["sigma_after"] / record["sigma_before"], ".3f"),
                optional(record["sigma_bound"] / record["sigma_before"], ".3f"),
            )
            for record in self.records()
        ]
        return Table(HEAD, tuple(rows))

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-design/1``."""
        design_result, robust = self.design, self.robustness
        sigmas_before = design_result.problem.sigmas_before
        return {
            "schema": SCHEMA,
            "parameters": {
                name: {
                    "sigma_before": sigmas_before[name],
                    "sigma_after": design_result.sigmas_after.get(name),
                    "sigma_bound": design_result.sigma_bounds.get(name),
                }
                for name in design_result.problem.parameters
            },
            "objective": {
                "value": design_result.value,
                "bound": design_result.optimum.bound,
                "gap": design_result.optimum.gap,
            },
            "limits": {
                stage.run.experiment: {
                    limit.name: {
                        "limit": limit.value,
                        "reached": self.limits_reached[stage.run.experiment][limit.name],
                    }
                    for limit in stage.active_limits
                }
                for stage in design_result.problem.experiments
            },
            "robustness": robust
            and {"loss": robust.loss, "reached": robust.max_limit_ratio, "corners": robust.draws},
            "efficiency": design_result.efficiency,
            "complete": design_result.complete,
            "hours": design_result.duration / HOUR,
            "hours_bound": None if design_result.min_duration is None else design_result.min_duration / HOUR,
            "inertial": self._inertial_document(),
        }

    def _inertial_document(self) -> dict[str, Any] | None:
        angles = self.design.angles
        if angles is None:
            return None
        hours_before, hours_after = (seconds / HOUR for seconds in angles.durations)
        parameters = {
            name: {
                "sigma_before": angles.sigmas_before[name],
                "sigma_wanted": target,
                "sigma_after": angles.sigmas_after[name],
            }
            for name, target in angles.target_sigmas.items()
        }
        return {"parameters": parameters, "hours_before": hours_before, "hours_after": hours_after}

    def summary(self) -> Iterator[str]:
        """Yield sentences about objective, bound and hours."""
        design_result = self.design
        if not design_result.complete:
            yield "interrupted: these are the best tones so far"
        kind = "largest ratio" if design_result.problem.objective.minimax else "geometric mean of the ratios"
        bound = design_result.optimum.bound
        yield f"{kind}: {design_result.value:.4f}; bound at the limits on rms: {bound:.4f}"
        if design_result.min_duration is not None:
            yield (
                f"{design_result.duration / HOUR:.2f} h with tones; no design of the same experiments does "
                f"with less than {design_result.min_duration / HOUR:.2f} h"
            )
        if design_result.angles:
            sigmas_before, after = (seconds / HOUR for seconds in design_result.angles.durations)
            names_of_angles = ", ".join(design_result.angles.target_sigmas)
            yield f"{after:.1f} h of noise instead of {sigmas_before:.1f} h for {names_of_angles}"

    def check_valid(self) -> None:
        """Check the design against the campaign, its bound and its limits.

        Raises
        ------
        RunError
            If it does not determine what the campaign did, its forecast is below the bound, or the FMUs
            exceed a limit.
        """
        design_result = self.design
        if undetermined := [
            name for name in design_result.problem.parameters if name not in design_result.sigmas_after
        ]:
            raise RunError(
                f"{self.path}: the design does not determine {', '.join(undetermined)}, which the campaign "
                "did"
            )
        if design_result.complete and design_result.value < MIN_BOUND_RATIO * design_result.optimum.bound:
            raise RunError(
                f"{self.path}: the forecast of the design is below its lower bound, so one of the two is "
                "wrong"
            )
        exceeded = [
            f"{name}: {limit} at {ratio:.4f} of its limit"
            for name, ratios in self.limits_reached.items()
            for limit, ratio in ratios.items()
            if ratio > 1 + TOLERANCE
        ]
        if exceeded:
            raise RunError(f"{self.path}: limits are exceeded with the FMUs: {'; '.join(exceeded)}")

    def draw(self, path: PathLike) -> None:
        """Draw the information of tones by frequency, with the tones of the design (svg, pdf, png)."""
        from fit.figures import tones
        from fit.plotting import draw  # matplotlib, which nothing else needs

        frequency = np.geomspace(*GRID)
        marks = [
            (f"{name}: {tone.injection.into}", tone.injection.frequency, tone.sigma_growth)
            for name, designed in self.design.tones.items()
            for tone in designed
        ]
        draw(tones.tones(frequency, information_spectrum(self.design, frequency), marks)).save(Path(path))


@one_blas_thread
def design(
    campaign: CampaignLike,
    out: PathLike | None = None,
    *,
    jobs: int | None = None,
    progress: Progress = LOG,
) -> CampaignDesign:
    """Find the best injections of a campaign within limits, and write them as a campaign.

    The table ``[design]`` of the campaign sets objective and limits; without it, all that the campaign itself
    does not exceed, run by run. The tones are checked through the FMUs. Interrupted, the best tones so far
    are written.

    Parameters
    ----------
    campaign : Campaign or path
        What is redesigned.
    out : path, optional
        The file to write, which must end in ``.toml``; by default ``NAME-designed.toml``.
    jobs : int, optional
        Number of processes that step the FMUs, by default one per processor.
    progress : Progress, optional
        By default warnings are logged.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop, or is none of LISA Pathfinder.
    InputError
        If the campaign is wrong, has no tones to optimise or unattainable targets, if the file exists and is
        not an earlier design, or the solver is not installed (``lpfcosim[design]``).
    RunError
        If a run fails.
    """
    plan, source = resolve(campaign)
    path = Path(f"{source.stem if source else plan.name}-designed.toml")
    path = path if out is None else as_path(out, "the path of a file")
    check_file(path, loading.sources(source) if source else (), [".toml"])
    names.check_stem(path)
    if path.is_file() and not is_design(path):
        raise InputError(f"{path}: is there already and is no design, expected a new name")
    jobs = check_workers(jobs)
    check_options(progress)
    if source is None and not is_described_by_file(plan):
        raise InputError("design: a campaign that was changed in Python, expected one as its file has it")
    with prefix_errors(source):
        model = FitModel(plan, settings(plan.fit, "fit"))
        design_result = _search(plan, model, progress)
    text = source.read_text(encoding="utf-8") if source else ""
    atomic.write(path, campaign_text(design_result, path.stem, source.name if source else plan.name, text))
    loading.load(path)
    with progress.stage("check through the FMUs"):
        reached = verify_in_time_domain(design_result, jobs)
    robust = None
    if design_result.complete:
        with progress.stage("other truths and noise"):
            robust = robustness(design_result, model, update_progress)
    experiments = {experiment.name for experiment in design_result.campaign.experiments}
    dropped = tuple(e.name for e in plan.experiments if e.name not in experiments)
    return CampaignDesign(design_result, path, reached, robust, dropped)


def _search(plan: Campaign, model: FitModel, progress: Progress) -> Design:
    """Validate a campaign, and find its best injections."""
    validation.check_linear_model(plan, "a design is")
    validation.check_equation(plan, "a design is", DELTA_G)
    for doubt in validation.validate(plan).doubts:
        progress.warn(doubt)
    callbacks = SearchProgress(
        lambda value, bound: progress.note(f"programme: {value:.4f}, no design below {bound:.4f}"),
        lambda step, value: progress.note(f"{step}: {value:.4f}"),
        update_progress,
    )
    with progress.stage("search"):
        return find_design(plan, model, callbacks)
