"""The command ``run``: simulate, fit, report, and say what is missing where runs failed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import fit.errors
from fit.settings import Settings
from fit.warnings import FitWarning
from lpfcosim.campaign import Campaign
from lpfcosim.cli import fmu as cli_fmu
from lpfcosim.cli.common import about, check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.preparation import prepare
from lpfcosim.cosim import Engine, Interface, compatibility
from lpfcosim.errors import RunError
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import results_folder, runner
from lpfcosim.messages import grouped, names
from lpfcosim.models import world_of

if TYPE_CHECKING:
    from fit.results import Fit, Results


def run(
    campaign: Path,
    out: Path | None,
    console: Console,
    *,
    jobs: int | None,
    engine: Engine,
    scheduler: str | None,
    time_limit: float | None,
    rerun: bool,
    trusted: bool,
) -> None:
    """Simulate a campaign, fit it, report."""
    directory = out or Path(campaign.stem)
    check_folder(directory, "telemetry")
    plan, chosen, found = prepare(campaign, jobs, scheduler)
    fmus = cli_fmu.fmus(plan, console)
    how = runner.RunOptions(jobs, scheduler, engine, rerun, time_limit)
    with results_folder.lock(directory, "--out"), ExitStack() as stack:
        with about(campaign):
            held = stack.enter_context(archives.snapshot(plan, fmus, directory, trusted=trusted))
        for line in _replacements(plan, found.interfaces):
            console.note(line)
        for line in found.warnings:
            console.note(f"warning: {line}")
        done = _simulated(plan, directory, held, how, console)
        _fitted(plan, directory, done, chosen, console)


def _simulated(
    plan: Campaign, directory: Path, fmus: Mapping[str, Path], how: runner.RunOptions, console: Console
) -> runner.SimulationResult:
    """Simulate a campaign into a folder, which then holds all that it takes to do it again."""

    def begin(origin: runner.Provenance) -> None:
        for name in ("results.json", "report.html") if how.rerun else ():
            (directory / name).unlink(missing_ok=True)
        results_folder.write_provenance(
            directory, plan.tables, {r.model: fmus[r.model] for r in plan.replacements}, origin
        )

    with console.samples({r.name: r.n_samples for r in plan.runs}) as (progress, kept):
        listener = runner.ProgressCallbacks(progress, kept, console.note, begin)
        done = runner.simulate(plan, directory / "telemetry", fmus, how, listener)
    if saturated := runner.saturated_samples(done.files.values()):
        told = ", ".join(f"{n} samples of {name}" for name, n in saturated.items())
        console.note(f"warning: a command is at its limit, which the fit masks: {told}")
    return done


def _fitted(
    plan: Campaign, directory: Path, done: runner.SimulationResult, chosen: Settings, console: Console
) -> None:
    """Fit the experiments that are complete, and report them and what failed."""
    complete, missing = _divide(plan, done)
    if not complete:
        raise _error(plan, done, directory)
    from lpfcosim.cli.fit import calibrated  # slow to import

    causes = "; ".join(_causes(done))
    told = partial(_with_missing, missing=missing, causes=causes)
    try:
        calibrated(console, directory, complete, chosen, own=True, origin=done.origin, told=told)
    except fit.errors.CalibrationError as error:
        if not missing:
            raise
        raise RunError(f"{_error(plan, done, directory)}; of the others: {error}") from None
    if missing:
        raise _error(plan, done, directory)


def _divide(plan: Campaign, done: runner.SimulationResult) -> tuple[list[Path], dict[str, str]]:
    """Return the telemetry of the experiments that are complete, and why each of the others is not."""
    complete: list[Path] = []
    missing = {}
    for experiment in plan.experiments:
        failed = [(name, str(done.failures[name])) for name in experiment.run_names if name in done.failures]
        if failed:
            missing[experiment.name] = "; ".join(grouped(failed))
        else:
            complete += [done.files[name] for name in experiment.run_names]
    return complete, missing


def _with_missing(results: Results, missing: Mapping[str, str], causes: str) -> Results:
    """Add what is missing to results, where report and readers of the file see it."""
    if not missing:
        return results
    which = "experiments {} are" if len(missing) > 1 else "experiment {} is"
    warning = FitWarning("missing_run", (), f"{which.format(names(list(missing)))} missing: {causes}")

    def warned(fit: Fit) -> Fit:
        return replace(fit, warnings=(warning, *fit.warnings))

    extra = {**results.provenance.extra, "missing": dict(missing)}
    provenance = replace(results.provenance, extra=extra)
    if results.joint is not None:
        return replace(results, joint=warned(results.joint), provenance=provenance)
    experiments = {name: warned(fit) for name, fit in results.experiments.items()}
    return replace(results, experiments=experiments, provenance=provenance)


def _error(plan: Campaign, done: runner.SimulationResult, directory: Path) -> RunError:
    """Return what a command says that could not do everything."""
    failed = f"{len(done.failures)} of {len(plan.runs)} runs failed, see {directory / 'logs'}"
    return RunError(f"{failed}: {'; '.join(_causes(done))}")


def _causes(done: runner.SimulationResult) -> list[str]:
    return grouped((name, str(error)) for name, error in done.failures.items())


def _replacements(plan: Campaign, found: Sequence[Interface]) -> Iterator[str]:
    """Yield what there is to know of third-party FMUs in the loop."""
    run = plan.runs[0]
    by_model = {interface.model: interface for interface in found}
    for replacement in plan.replacements:
        interface = by_model[replacement.model]
        ignored = interface.ignored
        taken = [name for name in interface.settings if name not in ignored]
        told = f"takes {', '.join(taken) or 'no parameter'}{'; not ' if ignored else ''}{', '.join(ignored)}"
        yield f"{replacement.model}: {replacement.archive}, a third-party FMU; {told}"
    if plan.replacements:
        yield "stability and saturation are not checked beforehand, as its dynamics are not known"
    if untold := sorted(world_of(run).untold(run, compatibility.ignored_names(found))):
        yield f"true values not known, left out of /truth: {', '.join(untold)}"
