"""The best injections of a campaign within limits, checked through the FMUs, as a campaign to run."""

import tempfile
from collections.abc import Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fit.files import atomic
from fit.parallel import one_blas_thread
from fit.settings import settings
from fit.telemetry import read_all
from lpfcosim.campaign import Campaign, loading
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import Workers, results_folder, validation
from lpfcosim.experiment_design import (
    Design,
    FitModel,
    campaign_text,
    design_problem,
    is_design,
    limits,
    search,
    with_tones,
)
from lpfcosim.models import DELTA_G, model_of
from lpfcosim.spacecraft import FS
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_path, is_described_by_file, resolve
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.result import Columns, Result, Row, by_name
from lpfcosim.workflows.simulate import simulate

Array = NDArray[np.float64]

MIN_BOUND_RATIO = 0.98  # of the bound, below which a forecast proves a mistake; both are right to 1 %
TOLERANCE = 1e-3  # relative, by which a limit may be exceeded and still counts as kept


@dataclass(frozen=True, repr=False)
class CampaignDesign(Result[Row]):
    """A designed campaign; index it by the name of a parameter.

    Attributes
    ----------
    design : Design
        Tones, sigmas before and after, and the bound.
    path : Path
        The file of the campaign.
    limits_reached : mapping of str to mapping of str to float
        By experiment and limit, what its runs reach through the FMUs, in units of the limit.
    """

    columns: ClassVar[Columns] = {
        "parameter": lambda row: row["parameter"],
        "sigma": lambda row: f"{row['sigma_before']:.2g}",
        "designed": lambda row: f"{row['sigma_after']:.2g}",
        "ratio": lambda row: f"{row['sigma_after'] / row['sigma_before']:.3f}",
        "lower bound": lambda row: f"{row['sigma_bound'] / row['sigma_before']:.3f}",
    }
    design: Design
    path: Path
    limits_reached: Mapping[str, Mapping[str, float]]

    @property
    def entries(self) -> dict[str, Row]:
        """The sigmas by parameter."""
        return {row["parameter"]: row for row in self.rows()}

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about objective, bound and limits."""
        largest = max(ratio for ratios in self.limits_reached.values() for ratio in ratios.values())
        return (
            *(() if self.design.complete else ("interrupted: these are the best tones so far",)),
            f"geometric mean of the ratios: {self.design.value:.4f}; no design within the limits on rms goes "
            f"below {self.design.optimum.bound:.4f}",
            f"stepped through the FMUs, the runs reach {largest:.4f} of their limits",
        )

    def rows(self) -> list[Row]:
        """Return a row for each parameter, NaN where there is no number."""
        result = self.design
        return [
            {
                "parameter": name,
                "sigma_before": result.problem.sigmas_before[name],
                "sigma_after": result.sigmas_after.get(name, float("nan")),
                "sigma_bound": result.sigma_bounds[name],
            }
            for name in result.problem.parameters
        ]

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-design/1``."""
        result = self.design
        return {
            "schema": "lpf-design/1",
            "parameters": by_name(self.rows()),
            "objective": {"value": result.value, "bound": result.optimum.bound},
            "limits": {
                experiment.run.experiment: {
                    limit.name: {
                        "limit": limit.value,
                        "reached": self.limits_reached[experiment.run.experiment][limit.name],
                    }
                    for limit in experiment.active_limits
                }
                for experiment in result.problem.experiments
            },
            "efficiency": result.efficiency,
            "complete": result.complete,
        }

    def check_valid(self) -> None:
        """Check the design against the campaign, its bound and its limits.

        Raises
        ------
        RunError
            If it does not determine what the campaign did, its forecast is below the bound, or the FMUs
            exceed a limit.
        """
        result = self.design
        if missing := [name for name in result.problem.parameters if name not in result.sigmas_after]:
            raise RunError(
                f"{self.path}: the design does not determine {', '.join(missing)}, which the campaign did"
            )
        if result.value < MIN_BOUND_RATIO * result.optimum.bound:
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


@one_blas_thread
def design(
    campaign: CampaignLike,
    out: PathLike | None = None,
    *,
    jobs: int | None = None,
    progress: Progress = LOG,
) -> CampaignDesign:
    """Find the best injections of a campaign within limits, and write them as a campaign.

    The table ``[design]`` of the campaign sets weights and limits; without it, the limits are what each run
    of the campaign reaches itself. The tones are checked through the FMUs. Interrupted, the best tones so far
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
        If the campaign is wrong or has no tones to optimise, if the file exists and is not an earlier design,
        or the solver is not installed (``lpfcosim[design]``).
    RunError
        If a run fails.
    """
    plan, source = resolve(campaign)
    path = Path(f"{source.stem if source else plan.name}-designed.toml")
    path = path if out is None else as_path(out, "the path of a file")
    results_folder.check_file(path, loading.sources(source) if source else (), [".toml"])
    loading.check_stem(path)
    if path.is_file() and not is_design(path):
        raise InputError(f"{path}: is there already and is no design, expected a new name")
    Workers(jobs)  # refuses another number before the search
    if source is None and not is_described_by_file(plan):
        raise InputError("design: a campaign that was changed in Python, expected one as its file has it")
    with prefix_errors(source):
        result = _search(plan, progress)
    text = source.read_text(encoding="utf-8") if source else ""
    atomic.write(path, campaign_text(result, path.stem, source.name if source else plan.name, text))
    loading.load(path)
    with progress.stage("check through the FMUs"):
        return CampaignDesign(result, path, _limits_reached(result, jobs))


def _search(plan: Campaign, progress: Progress) -> Design:
    """Validate a campaign, and find its best injections."""
    fit_model = FitModel(plan, settings(plan.fit, "fit"))
    validation.check_linear_model(plan, "a design is")
    validation.check_equation(plan, "a design is", DELTA_G)
    for doubt in validation.validate(plan).doubts:
        progress.warn(doubt)
    with progress.stage("search"):
        return search(
            design_problem(plan, fit_model),
            fit_model,
            lambda value, bound: progress.note(f"programme: {value:.4f}, no design below {bound:.4f}"),
            lambda step, value: progress.note(f"{step}: {value:.4f}"),
        )


def _limits_reached(design: Design, jobs: int | None) -> dict[str, dict[str, float]]:
    """Return what every run reaches of its limits, stepped through the FMUs."""
    experiments = {e.run.experiment: e for e in design.problem.experiments}
    disturbed = {
        name for name, e in experiments.items() if e.run.injections or model_of(e.run).attitude_rates(e.run)
    }
    driven = _quantities(design.campaign, experiments.keys(), jobs)
    undriven = _quantities(with_tones(design.campaign, dict.fromkeys(disturbed, ())), disturbed, jobs)
    ratios = {}
    for name, experiment in experiments.items():
        # along x a static level is there from the first sample on; a rotating spacecraft settles
        response = {
            quantity: x - (undriven[name][quantity] if name in undriven else x[0])
            for quantity, x in driven[name].items()
        }
        ratios[name] = limits.limit_ratios(experiment.run, experiment.active_limits, response)
    return ratios


def _quantities(campaign: Campaign, experiments: Set[str], jobs: int | None) -> dict[str, dict[str, Array]]:
    """Simulate the sysid runs of some experiments without noise; return the limited quantities of each."""
    noise_free = tuple(
        replace(e, noise={}, noise_duration=0.0, sample_rate=FS)
        for e in campaign.experiments
        if e.name in experiments
    )
    if not noise_free:
        return {}
    plan = replace(campaign, experiments=noise_free, noise={}, events=None)
    runs = {run.experiment: run for run in plan.runs}
    with tempfile.TemporaryDirectory() as folder:
        telemetries = read_all(simulate(plan, folder, jobs=jobs))
        return {t.experiment: limits.quantities(runs[t.experiment], dict(t.channels)) for t in telemetries}
