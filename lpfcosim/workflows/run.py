"""A campaign simulated, fitted and reported; results say what is missing where runs failed."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from fit.errors import CalibrationError
from fit.findings import Finding
from fit.parallel import one_blas_thread
from fit.results import Fit, Results
from fit.settings import Settings, settings
from fit.telemetry import read_all
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import results_folder, runner, validation
from lpfcosim.messages import grouped, names
from lpfcosim.planned_experiments import check_parameters
from lpfcosim.workflows.calibration import Calibration, calibrate_into
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_path, resolve
from lpfcosim.workflows.progress import LOG, Progress, check_options
from lpfcosim.workflows.simulate import campaign_fmus, failure_causes, simulate_into


@dataclass(frozen=True, repr=False)
class CampaignRun(Calibration):
    """The results of a campaign.

    Attributes
    ----------
    telemetry : mapping of str to Path
        The files by run.
    failures : mapping of str to str
        By run that failed, why. Results are those of the other experiments.
    """

    telemetry: Mapping[str, Path]
    failures: Mapping[str, str]

    def check_sound(self) -> None:
        """Raise FitError if the uncertainties are not valid, and RunError if runs failed."""
        n_runs = len(self.failures) + len(self.telemetry)
        failure = _failure(self.path.parent, self.failures, n_runs)
        if failure:
            with _prefixed(failure):
                super().check_sound()
            raise failure
        super().check_sound()


@one_blas_thread
def run(
    campaign: CampaignLike,
    out: PathLike | None = None,
    *,
    jobs: int | None = None,
    executor: Executor | None = None,
    time_limit: float | None = None,
    rerun: bool = False,
    trusted: bool = False,
    progress: Progress = LOG,
) -> CampaignRun:
    """Simulate a campaign with the FMUs, fit it, and report.

    An interrupted call continues where it was. If a run fails, the experiments that are complete are fitted
    all the same: see `CampaignRun.failures`.

    Parameters
    ----------
    campaign : Campaign or path
        What to simulate.
    out : path, optional
        Folder of telemetry, results and report; by default it has the name of the campaign, or of its file.
    jobs : int, optional
        Number of processes, by default one per processor.
    executor : concurrent.futures.Executor, optional
        Simulates instead, in processes with the same file system, such as that of a Dask cluster.
    time_limit : float, optional
        Longest time that a run may take [s].
    rerun : bool
        Simulate again what was made with another campaign, seed, version or FMU.
    trusted : bool
        Let third-party FMUs run, which are native code.
    progress : Progress, optional
        By default warnings are logged.

    Raises
    ------
    InputError
        If the campaign is wrong or cannot be simulated, or the folder holds telemetry of another campaign.
    RunError
        If no experiment is complete, or the fit of those that are yields nothing.
    """
    check_options(progress, rerun=rerun, trusted=trusted)
    plan, source = resolve(campaign)
    directory = output_folder(out, plan, source)
    options = runner.RunOptions(jobs, executor, time_limit, rerun=rerun)
    fit_settings, validated = validate_simulation(plan, source, "a calibration is")
    with prefix_errors(source):
        check_parameters(plan, fit_settings.without_fmu_parameters())
    fmus = campaign_fmus(plan, progress)
    with results_folder.lock(directory, alternative=True):
        simulated = simulate_into(
            plan, source, directory, fmus, options, validated, progress, trusted=trusted
        )
        return _fit(plan, directory, simulated, fit_settings, progress)


def output_folder(out: PathLike | None, plan: Campaign, source: Path | None, suffix: str = "") -> Path:
    """Return the folder for results: by default it has the name of the input."""
    if out is not None:
        return as_path(out, "the path of a folder")
    return Path(f"{source.stem if source else plan.name}{suffix}")


def validate_simulation(
    plan: Campaign, source: Path | None, quantity: str, *equations: str
) -> tuple[Settings, validation.Validation]:
    """Validate a campaign that is to be simulated and fitted, and read its settings of the fit.

    Parameters
    ----------
    plan : Campaign
        The campaign.
    source : Path, optional
        Its file.
    quantity : str
        What the fit is for, and "is" or "are".
    *equations : str
        Equations of motion that will do, see `validation.check_equation`.

    Raises
    ------
    InputError
        If it cannot be simulated.
    """
    with prefix_errors(source):
        validation.check_equation(plan, quantity, *equations)
        return settings(plan.fit, "fit"), validation.validate(plan)


def _fit(
    plan: Campaign,
    directory: Path,
    simulated: runner.SimulationResult,
    fit_settings: Settings,
    progress: Progress,
) -> CampaignRun:
    """Fit the experiments that are complete, and report them and the failures."""
    failures = {name: str(error) for name, error in simulated.failures.items()}
    failure = _failure(directory, failures, len(plan.runs))
    missing = {
        e.name: "; ".join(grouped((name, failures[name]) for name in e.run_names if name in failures))
        for e in plan.experiments
        if failures.keys() & {*e.run_names}
    }
    complete = [e for e in plan.experiments if e.name not in missing]
    if failure and not complete:
        raise failure
    with _prefixed(failure):
        with progress.stage("reading"):
            files = [simulated.files[name] for e in complete for name in e.run_names]
            telemetries = read_all(files, trusted=True)
        fitted = calibrate_into(
            directory,
            telemetries,
            fit_settings,
            progress,
            provenance={**simulated.provenance, **({"missing": missing} if missing else {})},
            amend=partial(_with_missing, missing=[*missing], causes="; ".join(failure_causes(simulated))),
        )
    return CampaignRun(fitted.results, fitted.path, fitted.report, simulated.files, failures)


@contextmanager
def _prefixed(failure: RunError | None) -> Iterator[None]:
    """Begin an error of the fit with that of the runs that failed, if there are any."""
    try:
        yield
    except CalibrationError as error:
        if failure:
            raise RunError(f"{failure}; remaining experiments: {error}") from None
        if isinstance(error, InputError):  # about the telemetry: the campaign was found valid
            raise RunError(str(error)) from None
        raise


def _with_missing(results: Results, missing: Sequence[str], causes: str) -> Results:
    """Add a warning of missing experiments, for the report and the readers of the file."""
    if not missing:
        return results
    subject = "experiments {} are" if len(missing) > 1 else "experiment {} is"
    warning = Finding("missing_run", f"{subject.format(names(missing))} missing: {causes}")

    def with_warning(fit: Fit) -> Fit:
        return replace(fit, warnings=(warning, *fit.warnings))

    if results.joint is not None:
        return replace(results, joint=with_warning(results.joint))
    return replace(
        results, experiments={name: with_warning(fit) for name, fit in results.experiments.items()}
    )


def _failure(directory: Path, failures: Mapping[str, str], n_runs: int) -> RunError | None:
    """Return the error of a campaign of which runs failed."""
    causes = "; ".join(grouped(failures.items()))
    n_failures, logs = len(failures), directory / "logs"
    return RunError(f"{n_failures} of {n_runs} runs failed, see {logs}: {causes}") if failures else None
