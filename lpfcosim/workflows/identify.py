"""Parameters of the FMUs in the loop, estimated from telemetry by simulating the loop with trial values."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from fit.crosstalk import refit
from fit.errors import FitError
from fit.forecasting import coverage
from fit.identification import FreeParameter
from fit.identification import identify as estimate
from fit.parallel import one_blas_thread, serial
from fit.report import page as fit_report
from fit.results import Results, write
from fit.settings import Group, Settings, refuse_narrow_band, settings
from fit.telemetry import Telemetry, read_truth
from fit.warnings import FitWarning
from fit.whitening import Experiment
from lpfcosim.campaign import Campaign
from lpfcosim.cosim import SimulationProgress, read_interfaces_of_runs, warnings
from lpfcosim.errors import InputError, RunError, as_run_error, prefix_errors
from lpfcosim.execution import Tasks, Workers, results_folder, runner, validation
from lpfcosim.execution import fmus as fmu_archives
from lpfcosim.identification import ClosedLoopResponse, Target, check, targets
from lpfcosim.models import DELTA_G
from lpfcosim.workflows.arguments import check_options
from lpfcosim.workflows.calibration import Calibration, calibrate_into, constrain, read_telemetry
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_paths, resolve
from lpfcosim.workflows.fmus import campaign_fmus
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.run import output_folder

RESULTS = "identified.json"  # which the report looks for
MAX_START_DISTANCE = (
    100.0  # natural scales from the value of the campaign: beyond, the search would not begin
)
MIN_RELATIVE_SCALE = 1e-9  # of a value: less is lost in the rounding of what is simulated
# Simulations of every run in a search, as a rule: iterations, and responses to a pulse.
ITERATIONS, PULSE_RESPONSES = 3, 2


@dataclass(frozen=True, repr=False)
class Identification(Calibration):
    """Parameters of the FMUs in the loop: estimates like those of a fit, named ``MODEL.VARIABLE``."""

    def check_sound(self) -> None:
        """Raise FitError if the uncertainties are not valid, or nothing is determined."""
        super().check_sound()
        if self.results.joint is not None and not self.results.joint.parameters:
            raise FitError(
                f"{self.path}: joint: no parameter listed in [identify] is determined; the warnings give "
                "the reasons"
            )


@dataclass(frozen=True)
class _Task:
    """An identification as it is handed to a process.

    Attributes
    ----------
    plan : Campaign
        What is in the loop, and which parameters are estimated.
    source : Path or None
        Its file.
    fmus : mapping of str to Path
        By model.
    directory : Path
        With results and telemetry.
    fit_settings : Settings
        With the constraints of the parameters.
    """

    plan: Campaign
    source: Path | None
    fmus: Mapping[str, Path]
    directory: Path
    fit_settings: Settings

    def __call__(self, _item: None, progress: SimulationProgress) -> Results:
        """Identify in a worker: one thread, so that it is known which FMU is at work."""
        with as_run_error(), serial(), ExitStack() as stack, prefix_errors(self.source):
            results, telemetries = refit.load(self.directory)
            prepared = self.prepare(results, telemetries)
            loop = self.load_loop(stack, prepared[0], progress)
            return self.identify(loop, prepared, results, telemetries)

    def prepare(
        self, results: Results, telemetries: Sequence[Telemetry]
    ) -> tuple[Sequence[Experiment], Settings]:
        """Return the experiments of the fit and its settings, with the constraints of the parameters."""
        experiments, fitted = refit.experiments(results, telemetries, self.directory / "results.json")
        parameters = {**fitted.parameters, **self.fit_settings.parameters}
        return experiments, fitted.model_copy(update={"parameters": parameters})

    def load_loop(
        self,
        stack: ExitStack,
        experiments: Sequence[Experiment],
        fmu_progress: SimulationProgress | None = None,
    ) -> ClosedLoopResponse:
        """Load the FMUs of the loop of every run."""
        runs = [run.telemetry for e in experiments for run in (e.sysid, e.noise) if run]
        return ClosedLoopResponse(stack, self.plan, runs, self.fmus, fmu_progress)

    def identify(
        self,
        loop: ClosedLoopResponse,
        prepared: tuple[Sequence[Experiment], Settings],
        results: Results,
        telemetries: Sequence[Telemetry],
    ) -> Results:
        """Estimate the parameters, and add warnings and true values."""
        experiments, fit_settings = prepared
        free = [free_parameter(target) for target in loop.targets]
        identified = estimate(experiments, free, loop, results, fit_settings, loop.fixed_values)
        variables = {t.name: {"model": t.model, "variable": t.variable} for t in loop.targets}
        extra = {**identified.provenance.extra, "identified": variables}
        identified = replace(identified, provenance=replace(identified.provenance, extra=extra))
        if loop.loop_mismatch and identified.joint is not None:
            message = f"the telemetry says that it was simulated otherwise: {loop.loop_mismatch}"
            joint_warnings = (*identified.joint.warnings, FitWarning("loop_mismatch", (), message))
            identified = replace(identified, joint=replace(identified.joint, warnings=joint_warnings))
        truths = {t.run: _truth(t, self.plan, loop.targets) for t in telemetries}
        return coverage.with_truth(identified, telemetries, truths)


@one_blas_thread
def identify(
    campaign: CampaignLike,
    paths: PathLike | Sequence[PathLike] = (),
    out: PathLike | None = None,
    *,
    parameters: Mapping[str, Mapping[str, object]] | None = None,
    trusted: bool = False,
    progress: Progress = LOG,
) -> Identification:
    """Estimate parameters of the FMUs in the loop.

    The closed loop is simulated through the FMUs with trial values; ``o_1`` and ``f_x_1`` are imposed as
    measured, ``o_12`` is compared.

    Parameters
    ----------
    campaign : Campaign or path
        With the parameters in its table ``[identify]``; by default those of a calibration.
    paths : path or paths, optional
        Telemetry, folders of it or maps of archives; by default what `run` left in the folder `out`.
    out : path, optional
        Folder of ``identified.json``, by default ``NAME``, or ``NAME-identified`` with `paths`.
    parameters : mapping, optional
        Constraints by parameter, as in the table ``[fit.parameters]``.
    trusted : bool
        Let FMUs run that are not built here and not approved.
    progress : Progress, optional
        By default warnings are logged.

    Raises
    ------
    InputError, FitError, RunError
        If the input is wrong; if no valid estimate results; if an FMU fails.
    """
    plan, source = resolve(campaign)
    check_options(progress, trusted=trusted)
    directory = output_folder(out, plan, source, "-identified" if paths else "")
    files = as_paths(paths, "the path of telemetry")
    with prefix_errors(source):
        plan_settings = _validate(plan, trusted=trusted)
    fit_settings, fmus = constrain(plan_settings, parameters), campaign_fmus(plan, progress)
    with prefix_errors(source):
        interfaces = read_interfaces_of_runs(plan.runs, fmus)
        for target in targets(plan, plan.runs[0], interfaces):
            free_parameter(target)  # refused before anything takes its time
    for warning in warnings(interfaces):
        progress.warn(warning)
    results, telemetries = _calibrated(plan, source, files, directory, fit_settings, progress)
    with results_folder.lock(directory, alternative=True), ExitStack() as stack:
        with prefix_errors(source):
            copies = stack.enter_context(fmu_archives.snapshot(plan, fmus, directory, trusted=trusted))
        task = _Task(plan, source, dict(copies), directory, fit_settings)
        if plan.replacements:
            identified = _identify_in_process(task, progress)
        else:
            identified = _identify(task, results, telemetries, progress)
        write(identified, directory / RESULTS)
        with progress.stage("report"):
            report = fit_report.write_report(directory, results, telemetries)
    return Identification(identified, directory / RESULTS, report)


def _validate(plan: Campaign, *, trusted: bool) -> Settings:
    """Refuse a campaign of which nothing can be identified; return the settings of its fit."""
    if not any(run.kind == "sysid" for run in plan.runs):
        raise InputError("experiments: only noise runs, expected one with injections")
    fit_settings = settings(plan.fit, "fit")
    refuse_narrow_band(fit_settings, "identify", "fit")
    validation.check_equation(plan, "an identification is", DELTA_G)
    validation.validate(plan)
    # Before telemetry is fitted; `fmus.snapshot` checks the copies that are loaded.
    fmu_archives.check(plan, {r.model: r.archive for r in plan.replacements}, trusted=trusted)
    return fit_settings


def _calibrated(
    plan: Campaign,
    source: Path | None,
    files: Sequence[Path],
    directory: Path,
    fit_settings: Settings,
    progress: Progress,
) -> tuple[Results, Sequence[Telemetry]]:
    """Return the results of the fit of the same telemetry, which is fitted if it comes from elsewhere."""
    path = directory / "results.json"
    if files:
        _calibrate(plan, files, directory, fit_settings, progress)
    elif not path.is_file():
        name = source or f"{plan.name}.toml"
        raise InputError(
            f"{path}: no such file, expected what lpfcosim run leaves, or telemetry: give the command "
            f"lpfcosim run {name}, or add files to this one"
        )
    with progress.stage("reading"):
        results, telemetries = refit.load(directory)
    place = f"{path}: provenance.settings"
    refuse_narrow_band(settings(results.provenance.settings, place), "identify", place)
    check(plan, telemetries)
    return results, telemetries


def _calibrate(
    plan: Campaign, files: Sequence[Path], directory: Path, fit_settings: Settings, progress: Progress
) -> None:
    """Fit telemetry by the equation of motion; results that are not sound do not preclude a better model."""
    telemetries = read_telemetry(files, directory, progress)
    check(plan, telemetries)
    (directory / "results.json").unlink(missing_ok=True)
    calibration = calibrate_into(directory, telemetries, fit_settings, progress)
    try:
        calibration.check_sound()
    except FitError as error:
        progress.warn(str(error))


def _identify(task: _Task, results: Results, telemetries: Sequence[Telemetry], progress: Progress) -> Results:
    with progress.stage("preparation"):
        prepared = task.prepare(results, telemetries)
    with ExitStack() as stack, prefix_errors(task.source):
        with progress.stage("loading"):
            loop = task.load_loop(stack, prepared[0])
        n_runs, n_parameters = sum(2 if e.noise else 1 for e in prepared[0]), len(loop.targets)
        total = (ITERATIONS + PULSE_RESPONSES) * n_runs + 2 * n_parameters * len(prepared[0])
        with progress.counted("simulations", total) as loop.on_simulation:
            return task.identify(loop, prepared, results, telemetries)


def _identify_in_process(task: _Task, progress: Progress) -> Results:
    """Identify in a process of its own, which third-party FMUs may crash."""
    name = "identification"
    models = runner.fmu_order(task.plan)
    tasks = Tasks(task, {name: None}, task.directory, task.directory / "logs", "{}", models)
    with progress.stage(name):
        ((_, outcome),) = Workers(1).results(tasks)
    if isinstance(outcome, InputError | RunError):
        raise outcome
    assert isinstance(outcome, Results)
    return outcome


def _truth(telemetry: Telemetry, plan: Campaign, parameters: Sequence[Target]) -> dict[str, float]:
    """Return the true values of a run; if this very campaign simulated it, of every parameter of an FMU."""
    known = read_truth(telemetry.path) if telemetry.path.is_file() else {}
    if telemetry.attributes.get("campaign_digest") != plan.digest:
        return known
    return {t.name: t.default_value for t in parameters if "." in t.name} | known


def free_parameter(target: Target) -> FreeParameter:
    """Return a parameter as the estimation has it."""
    request, place = target.request, f"identify.{target.name}"
    start, width = request.start, request.width
    low, high = request.bounds or target.limits
    of_fmu = "." in target.name
    if of_fmu and start is None:
        start = target.default_value
    if of_fmu and width is None and not start:
        if request.bounds is None:
            raise InputError(f"{place}: starts at 0, which gives no scale; expected a width or bounds")
        width = (high - low) / 2
    group: Group = "alignment_epoch" if target.name == "delta_ifo" else "campaign"
    free = FreeParameter(target.name, start, width, (low, high), request.shared or group, target.unit)
    if start is not None and not low <= start <= high:
        raise InputError(
            f"{place}.start: {start:g}, expected {low:.4g} to {high:.4g}, what is possible about the "
            f"{target.default_value:.5g} of the campaign; bounds of yours allow more"
        )
    scale = free.scale
    if scale < MIN_RELATIVE_SCALE * max(abs(target.default_value), abs(start or 0.0)):
        raise InputError(f"{place}.width: {scale:g} is too small for numbers of 16 digits, expected more")
    reach = MAX_START_DISTANCE * scale
    if request.start is not None and not of_fmu and abs(request.start - target.default_value) > reach:
        raise InputError(
            f"{place}.start: {request.start:g}, expected a value within {reach:.2g} of "
            f"{target.default_value:.4g}, that of the campaign; a larger width allows more"
        )
    return free
