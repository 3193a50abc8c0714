"""The command ``identify``: parameters of the FMUs in the loop, estimated from telemetry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import fit.errors
from fit.crosstalk import refit
from fit.forecasting import coverage
from fit.identification import FreeParameter, identify
from fit.parallel import serial
from fit.report import page as fit_report
from fit.results import Results, write
from fit.settings import Group, Settings, refuse_narrow_band, settings
from fit.telemetry import Telemetry, read_truth
from fit.warnings import FitWarning
from fit.whitening import Experiment
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cli import fmu as cli_fmu
from lpfcosim.cli.common import about, check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.constraints import Constraints
from lpfcosim.cli.fit import calibrated, telemetry
from lpfcosim.cosim import SimulationProgress, interfaces_of_runs, warnings
from lpfcosim.errors import InputError, LpfcosimError, RunError, ours
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import process_pool, results_folder, runner, validation
from lpfcosim.identification import Simulation, Target, check, targets

RESULTS = "identified.json"  # which the report looks for
FAR = 100.0  # natural scales from where the campaign has a parameter: there the search would not begin
FINEST = 1e-9  # of a value: less is lost in the rounding of what is simulated
ROUNDS, BLOWS = 3, 2  # of a search, as a rule: simulations of every run, and how many tell what moves it


def identify_files(
    campaign: Path,
    paths: Sequence[Path],
    out: Path | None,
    console: Console,
    *,
    trusted: bool,
    constraints: Constraints,
) -> None:
    """Estimate the parameters that a campaign seeks from telemetry, and report.

    Raises
    ------
    FitError
        At the end, if sigmas do not hold or nothing is determined.
    """
    plan = loading.load(campaign)
    if not any(run.kind == "sysid" for run in plan.runs):
        raise InputError(f"{campaign}: experiments: only noise runs, expected one with injections")
    chosen = constraints.on(settings(plan.fit, f"{campaign}: fit"))
    refuse_narrow_band(chosen, "identify", f"{campaign}: fit")
    directory = out or Path(f"{campaign.stem}-identified" if paths else campaign.stem)
    check_folder(directory, "telemetry")
    with about(campaign):
        validation.validate(plan)
        # Before telemetry is fitted; `archives.snapshot` checks the copies that are loaded.
        archives.check(plan, {r.model: r.archive for r in plan.replacements}, trusted=trusted)
    fmus = cli_fmu.fmus(plan, console)
    with about(campaign):
        placed = interfaces_of_runs(plan.runs, fmus)
        for target in targets(plan, plan.runs[0], placed):
            _free(target)  # before anything takes its time
    for line in warnings(placed):
        console.note(f"warning: {line}")
    if paths:
        _fitted(plan, paths, directory, console, chosen)
    elif not (directory / "results.json").is_file():
        raise InputError(
            f"{directory / 'results.json'}: no such file, expected what lpfcosim run leaves, or telemetry: "
            f"give the command lpfcosim run {campaign}, or add files to this one"
        )
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    place = f"{directory / 'results.json'}: provenance.settings"
    refuse_narrow_band(settings(results.provenance.settings, place), "identify", place)
    check(plan, telemetries)
    with results_folder.lock(directory, "--out"), ExitStack() as stack:
        with about(campaign):
            held = stack.enter_context(archives.snapshot(plan, fmus, directory, trusted=trusted))
        found = _identified(plan, campaign, held, results, telemetries, directory, console, chosen)
        document = write(found, directory / RESULTS)
        with console.stage("report"):
            page = fit_report.write_report(directory, results, telemetries)
    console.table(found)
    console.document(document)
    console.say(f"identified: {directory / RESULTS}, report: {page}")
    _check_sound(found, directory / RESULTS)


def _check_sound(results: Results, path: Path) -> None:
    """Raise FitError if sigmas do not hold, or nothing is determined."""
    for place, warning in results.unsound:
        raise fit.errors.FitError(f"{path}: {place}: {warning.message}")
    if results.joint is not None and not results.joint.parameters:
        raise fit.errors.FitError(
            f"{path}: joint: nothing that is sought is determined; the warnings say why"
        )


def _fitted(
    plan: Campaign, paths: Sequence[Path], directory: Path, console: Console, chosen: Settings
) -> None:
    """Fit telemetry by the equation of motion; that this is unsound must not keep from a better model."""
    found = telemetry(console, paths, directory, any_gaps=False)

    def admitted(telemetries: Sequence[Telemetry]) -> None:
        check(plan, telemetries)
        (directory / "results.json").unlink(missing_ok=True)

    try:
        calibrated(console, directory, found, chosen, admitted=admitted, printed=False)
    except fit.errors.FitError as error:
        if not (directory / "results.json").is_file():
            raise
        console.note(f"warning: {error}")


def _identified(
    plan: Campaign,
    campaign: Path,
    fmus: Mapping[str, Path],
    results: Results,
    telemetries: Sequence[Telemetry],
    directory: Path,
    console: Console,
    chosen: Settings,
) -> Results:
    if plan.replacements:
        return _apart(plan, campaign, fmus, directory, console, chosen)
    with console.stage("preparation"):
        prepared = _prepared(results, telemetries, directory, chosen)
    with ExitStack() as stack, about(campaign):
        with console.stage("loading"):
            loop = _simulation(stack, plan, prepared[0], fmus)
        runs, parameters = sum(2 if e.noise else 1 for e in prepared[0]), len(loop.targets)
        total = (ROUNDS + BLOWS) * runs + 2 * parameters * len(prepared[0])
        with console.counted("simulations", total) as loop.on_simulation:
            return _found(plan, loop, prepared, results, telemetries)


def _prepared(
    results: Results, telemetries: Sequence[Telemetry], directory: Path, chosen: Settings
) -> tuple[Sequence[Experiment], Settings]:
    """Return the experiments of the fit and its settings, with the constraints of the command on top."""
    experiments, fitted = refit.experiments(results, telemetries, directory / "results.json")
    return experiments, fitted.model_copy(update={"parameters": {**fitted.parameters, **chosen.parameters}})


def _apart(
    plan: Campaign,
    campaign: Path,
    fmus: Mapping[str, Path],
    directory: Path,
    console: Console,
    chosen: Settings,
) -> Results:
    """Identify in a process of its own, that FMUs of other origin may crash."""
    name = "identification"
    setting = process_pool.WorkerConfig(_alone, directory, directory / "logs", "{}")
    with console.stage(name):
        ((_, outcome),) = process_pool.results(
            setting, {name: (plan, campaign, dict(fmus), directory, chosen)}, 1
        )
    if isinstance(outcome, process_pool.WorkerFailure):
        raise RunError(f"{name}: {runner.failed_component(plan.runs[0], outcome)} {outcome.description}")
    if isinstance(outcome, LpfcosimError):
        raise outcome
    assert isinstance(outcome, Results)
    return outcome


def _alone(
    plan: Campaign,
    campaign: Path,
    fmus: Mapping[str, Path],
    directory: Path,
    chosen: Settings,
    where: SimulationProgress,
) -> Results:
    """Do that, in a worker: one thread, so that it is known which FMU is at work."""
    with ours(), serial(), ExitStack() as stack, about(campaign):
        results, telemetries = refit.load(directory)
        prepared = _prepared(results, telemetries, directory, chosen)
        loop = _simulation(stack, plan, prepared[0], fmus, where)
        return _found(plan, loop, prepared, results, telemetries)


def _simulation(
    stack: ExitStack,
    plan: Campaign,
    experiments: Sequence[Experiment],
    fmus: Mapping[str, Path],
    where: SimulationProgress | None = None,
) -> Simulation:
    runs = [run.telemetry for e in experiments for run in (e.sysid, e.noise) if run]
    return Simulation(stack, plan, runs, fmus, where)


def _found(
    plan: Campaign,
    loop: Simulation,
    prepared: tuple[Sequence[Experiment], Settings],
    results: Results,
    telemetries: Sequence[Telemetry],
) -> Results:
    experiments, chosen = prepared
    free = [_free(target) for target in loop.targets]
    with ours():
        found = identify(experiments, free, loop, results, chosen, loop.fixed_values)
    sought = {t.name: {"model": t.model, "variable": t.variable} for t in loop.targets}
    extra = {**found.provenance.extra, "identified": sought}
    found = replace(found, provenance=replace(found.provenance, extra=extra))
    if loop.other_loop_description and found.joint is not None:
        message = f"the telemetry says that it was simulated otherwise: {loop.other_loop_description}"
        warnings = (*found.joint.warnings, FitWarning("loop_mismatch", (), message))
        found = replace(found, joint=replace(found.joint, warnings=warnings))
    return coverage.with_truth(
        found, telemetries, {t.run: _truth(t, plan, loop.targets) for t in telemetries}
    )


def _truth(telemetry: Telemetry, plan: Campaign, sought: Sequence[Target]) -> dict[str, float]:
    """Return what is true of a run; if this very campaign simulated it, of every parameter of an FMU."""
    known = read_truth(telemetry.path) if telemetry.path.is_file() else {}
    if telemetry.attributes.get("campaign_digest") != plan.digest:
        return known
    return {t.name: t.default_value for t in sought if "." in t.name} | known


def _free(target: Target) -> FreeParameter:
    """Return a parameter as the estimation has it."""
    sought, where = target.request, f"identify.{target.name}"
    start, width = sought.start, sought.width
    low, high = sought.bounds or target.limits
    if "." in target.name and start is None:
        start = target.default_value
    if "." in target.name and width is None and not start:
        if sought.bounds is None:
            raise InputError(f"{where}: starts at 0, which tells no scale; expected a width or bounds")
        width = (high - low) / 2
    of_epoch: Group = "alignment_epoch" if target.name == "delta_ifo" else "campaign"
    free = FreeParameter(target.name, start, width, (low, high), sought.shared or of_epoch, target.unit)
    if start is not None and not low <= start <= high:
        raise InputError(
            f"{where}.start: {start:g}, expected {low:.4g} to {high:.4g}, what is possible about the "
            f"{target.default_value:.5g} of the campaign; bounds of yours allow more"
        )
    scale = free.scale
    if scale < FINEST * max(abs(target.default_value), abs(start or 0.0)):
        raise InputError(f"{where}.width: {scale:g} is too small for numbers of 16 digits, expected more")
    within = FAR * scale
    if (
        sought.start is not None
        and "." not in target.name
        and abs(sought.start - target.default_value) > within
    ):
        raise InputError(
            f"{where}.start: {sought.start:g}, expected a value within {within:.2g} of "
            f"{target.default_value:.4g}, that of the campaign; a larger width allows more"
        )
    return free
