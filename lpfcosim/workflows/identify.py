"""Parameters of the FMUs in the loop, estimated from telemetry by simulating the loop with trial values."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, nullcontext
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
from fit.settings import Settings, refuse_narrow_band, settings
from fit.telemetry import Telemetry, read_truth
from lpfcosim.campaign import Campaign
from lpfcosim.cosim import SimulationProgress, read_interfaces_of_runs, warnings
from lpfcosim.errors import InputError, as_run_error, prefix_errors
from lpfcosim.execution import Tasks, Workers, results_folder, runner, validation
from lpfcosim.execution import fmus as fmu_archives
from lpfcosim.identification import ClosedLoopResponse, Target, run_of, targets
from lpfcosim.models import DELTA_G
from lpfcosim.workflows.calibration import Calibration, calibrate_into, constrain, read_telemetry
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_paths, resolve
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.run import output_folder
from lpfcosim.workflows.simulate import campaign_fmus

RESULTS = "identified.json"  # which the report looks for
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

    The closed loop is simulated with trial values; ``o_1`` and ``f_x_1`` are imposed, ``o_12`` is compared.

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
        Let third-party FMUs run, which are native code.
    progress : Progress, optional
        By default warnings are logged.

    Raises
    ------
    InputError, FitError, RunError
        If the input is wrong; if no valid estimate results; if an FMU fails.
    """
    plan, source = resolve(campaign)
    directory = output_folder(out, plan, source, "-identified" if paths else "")
    files = as_paths(paths, "the path of telemetry")
    with prefix_errors(source):
        fit_settings = constrain(_validate(plan, trusted=trusted), parameters)
    fmus = campaign_fmus(plan, progress)
    with prefix_errors(source):
        n_targets = _check_targets(plan, fmus, progress)
    if files:
        _calibrate(plan, files, directory, fit_settings, progress)
    else:
        _check_results(directory / "results.json", source or Path(f"{plan.name}.toml"))
    with results_folder.lock(directory, alternative=True), ExitStack() as stack:
        with prefix_errors(source):
            copies = stack.enter_context(fmu_archives.snapshot(plan, fmus, directory, trusted=trusted))
        with progress.stage("reading"):
            results, telemetries = _read(plan, directory)
        n_simulations = len(telemetries) * (ITERATIONS + PULSE_RESPONSES + n_targets)
        with progress.counted("simulations", n_simulations) as count:
            identified = _in_worker(_Task(plan, source, copies, directory, fit_settings), count)
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
    fmu_archives.check_trust(plan, trusted=trusted)
    return fit_settings


def _check_targets(plan: Campaign, fmus: Mapping[str, Path], progress: Progress) -> int:
    """Refuse parameters that cannot be identified, before anything takes its time; return their number."""
    interfaces = read_interfaces_of_runs(plan.runs, fmus)
    parameters = [free_parameter(target) for target in targets(plan, plan.runs[0], interfaces)]
    for warning in warnings(interfaces, plan.runs[0].h):
        progress.warn(warning)
    return len(parameters)


def _check_results(path: Path, campaign: Path) -> None:
    if not path.is_file():
        raise InputError(
            f"{path}: no such file, expected what lpfcosim run leaves, or telemetry: give the command "
            f"lpfcosim run {campaign}, or add files to this one"
        )


def _calibrate(
    plan: Campaign, files: Sequence[Path], directory: Path, fit_settings: Settings, progress: Progress
) -> None:
    """Fit telemetry by the equation of motion; results that are not sound do not preclude a better model."""
    telemetries = read_telemetry(files, directory, progress)
    for telemetry in telemetries:
        run_of(plan, telemetry)
    (directory / "results.json").unlink(missing_ok=True)
    calibration = calibrate_into(directory, telemetries, fit_settings, progress)
    try:
        calibration.check_sound()
    except FitError as error:
        progress.warn(str(error))


def _read(plan: Campaign, directory: Path) -> tuple[Results, Sequence[Telemetry]]:
    """Read the results of a fit that an identification can begin with, and the telemetry."""
    place = f"{directory / 'results.json'}: provenance.settings"
    results, telemetries = refit.load(directory)
    refuse_narrow_band(settings(results.provenance.settings, place), "identify", place)
    for telemetry in telemetries:
        run_of(plan, telemetry)
    return results, telemetries


@dataclass(frozen=True)
class _Task:
    """Identifies from fitted telemetry, in a worker process: a crash of an FMU ends that alone."""

    plan: Campaign
    source: Path | None
    fmus: Mapping[str, Path]
    directory: Path
    fit_settings: Settings

    def __call__(self, _item: None, progress: SimulationProgress) -> Results:
        path = self.directory / "results.json"
        results, telemetries = refit.load(self.directory)
        experiments, fitted = refit.experiments(results, telemetries, path)
        runs = [run.telemetry for e in experiments for run in (e.sysid, e.noise) if run]
        constraints = {**fitted.parameters, **self.fit_settings.parameters}
        # third-party FMUs may not stand being loaded by several threads
        with (
            as_run_error(),
            prefix_errors(self.source),
            serial() if self.plan.replacements else nullcontext(),
            ExitStack() as stack,
        ):
            loop = ClosedLoopResponse(stack, self.plan, runs, self.fmus, progress)
            identified = estimate(
                experiments,
                [free_parameter(target) for target in loop.targets],
                loop,
                results,
                fitted.model_copy(update={"parameters": constraints}),
                loop.fixed_values,
            )
        variables = {t.name: {"model": t.model, "variable": t.variable} for t in loop.targets}
        extra = {**identified.provenance.extra, "identified": variables}
        identified = replace(identified, provenance=replace(identified.provenance, extra=extra))
        truths = {t.run: _truth(t, self.plan, loop.targets) for t in telemetries}
        return coverage.with_truth(identified, telemetries, truths)


def _in_worker(task: _Task, on_simulation: Callable[[int], None]) -> Results:
    logs, models = task.directory / "logs", runner.fmu_order(task.plan)
    tasks = Tasks(task, {"identification": None}, task.directory, logs, "{}", models)
    with closing(Workers(1).results(tasks, lambda _, now: on_simulation(now.simulations))) as outcomes:
        ((_, outcome),) = outcomes
    if not isinstance(outcome, Results):
        tasks.append_to_log("identification", str(outcome))
        raise outcome
    return outcome


def _truth(telemetry: Telemetry, plan: Campaign, parameters: Sequence[Target]) -> dict[str, float]:
    """Return the true values of a run; if this very campaign simulated it, of every parameter of an FMU."""
    known = read_truth(telemetry.path) if telemetry.path.is_file() else {}
    if telemetry.attributes.get("campaign_digest") != plan.digest:
        return known
    return {t.name: t.default_value for t in parameters if "." in t.name} | known


def free_parameter(target: Target) -> FreeParameter:
    """Return a parameter as the estimation has it.

    Raises
    ------
    InputError
        If it has no natural scale, or one that numbers do not resolve.
    """
    request, place = target.request, f"identify.{target.name}"
    start, width = request.start, request.width
    low, high = request.bounds or target.limits
    if "." in target.name:  # of an FMU
        start = target.default_value if start is None else start
        if width is None and not start:
            if request.bounds is None:
                raise InputError(f"{place}: starts at 0, which gives no scale; expected a width or bounds")
            width = (high - low) / 2
    shared = request.shared or ("alignment_epoch" if target.name == "delta_ifo" else "campaign")
    free = FreeParameter(target.name, start, width, (low, high), shared, target.unit)
    if free.scale < MIN_RELATIVE_SCALE * max(abs(target.default_value), abs(start or 0.0)):
        raise InputError(
            f"{place}.width: {free.scale:g} is too small for numbers of 16 digits, expected more"
        )
    return free
