"""The commands ``run``, ``fit``, ``deltag`` and ``report``: where simulation and estimation meet."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import fit.errors
from fit import results as fit_results
from fit import settings as fit_settings
from fit.deltag import write_delta_g
from fit.errors import FitError
from fit.estimate import earlier, pulls
from fit.pipeline import calibrate, calibrate_inertial
from fit.report import page as fit_report
from fit.telemetry import convert, is_map
from fit.telemetry import reader as fit_telemetry
from lpfcosim.campaign import campaign as campaigns
from lpfcosim.cli import fmu as cli_fmu
from lpfcosim.cli import shortfall as cli_shortfall
from lpfcosim.cli.common import about, check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cosim import Engine, Interface, placement
from lpfcosim.errors import InputError, RunError
from lpfcosim.plant import stability
from lpfcosim.running import dossier, lock, runner, simulation, trust
from lpfcosim.running import ledger as files
from lpfcosim.worlds import world_of

VERSIONS = ("lpfcosim", "numpy", "scipy", "lmfit", "fmpy")  # on which results depend


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
    if jobs and scheduler:
        raise InputError("--jobs, --scheduler: expected one of them; a cluster has as many workers as it has")
    plan = campaigns.load(campaign)
    chosen = fit_settings.settings(plan.fit, f"{campaign}: fit")
    directory = out or Path(campaign.stem)
    check_folder(directory / "telemetry")
    with about(campaign):
        for entry in plan.runs if not plan.replacements else ():  # the poles are those of our loop
            stability.check(entry)
    fmus = cli_fmu.fmus(plan, console)
    with about(campaign):
        found = placement.interfaces(plan.runs[0], fmus)  # the other runs have the same
        trust.check(plan, fmus, trusted=trusted)
    for line in _told_of_replacements(plan, found):
        console.note(line)
    with lock.held(directory), simulation.held(plan, fmus, directory) as held:
        with about(campaign):
            trust.check(plan, held, trusted=trusted)  # what is loaded, as it is now
        theirs = {r.model: held[r.model] for r in plan.replacements}

        def begin() -> None:
            for name in ("results.json", "report.html") if rerun else ():
                (directory / name).unlink(missing_ok=True)
            dossier.keep(directory, campaign, theirs)

        with console.samples({r.name: r.n_samples for r in plan.runs}) as (progress, kept):
            done = runner.simulate(
                plan,
                directory / "telemetry",
                held,
                jobs=jobs,
                engine=engine,
                rerun=rerun,
                scheduler=scheduler,
                time_limit=time_limit,
                progress=progress,
                kept=kept,
                told=console.note,
                begin=begin,
            )
        for name, n in runner.saturated(done.files.values()).items():
            console.note(f"run {name}: a command is at its limit in {n} samples, which the fit masks")
        complete, missing = cli_shortfall.divide(plan, done)
        if not complete:
            raise cli_shortfall.error(plan, done, directory)
        origin = runner.provenance(plan, held)
        try:
            _calibrate(console, directory, complete, chosen, own=True, origin=origin, missing=missing)
        except fit.errors.CalibrationError as error:
            if not missing:
                raise
            raise RunError(f"{cli_shortfall.error(plan, done, directory)}; of the others: {error}") from None
        if missing:
            raise cli_shortfall.error(plan, done, directory)


def fit_files(
    paths: Sequence[Path],
    out: Path | None,
    console: Console,
    *,
    settings: Path | None,
    include_short: bool,
    calibration: Path | None,
) -> None:
    """Fit telemetry files from anywhere, report."""
    directory = out or _default_folder(paths[0])
    check_folder(directory / "telemetry")
    chosen = fit_settings.read(settings) if settings else fit_settings.settings()
    if include_short:
        chosen = chosen.model_copy(update={"include_short": True})
    found = _telemetry(console, paths, directory, any_gaps=False)
    _calibrate(console, directory, found, chosen, calibration=calibration)


def deltag(paths: Sequence[Path], calibration: Path, out: Path | None, console: Console) -> None:
    """Write the calibrated Delta g of telemetry files."""
    directory = out or _default_folder(paths[0], "deltag")
    check_folder(directory / "telemetry")
    results = fit_results.load(calibration)
    joint = _joint(results, calibration)
    for warning in joint.unsound:
        console.note(f"warning: {calibration}: joint: {warning.message}")
    inputs = fit_telemetry.files(_telemetry(console, paths, directory, any_gaps=True))
    fit_telemetry.check(inputs)
    outputs = {f"{path.stem}-deltag.h5": path for path in inputs}
    for path in inputs:
        if outputs[f"{path.stem}-deltag.h5"] is not path:
            raise InputError(f"{path}: a second file of that name, expected different names")
    origin = {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "calibration_sha256": files.digest(calibration),
    }
    for name, path in outputs.items():
        with lock.held(directory), console.stage(str(path)):
            notes = write_delta_g(path, directory / name, results, joint, {**origin, "source": path.name})
        for note in notes:
            console.note(f"warning: {note}")
        console.say(str(directory / name))


def report(directory: Path, console: Console) -> None:
    """Rebuild the report from what a folder holds."""
    results, telemetries = earlier.load(directory)
    with lock.held(directory), console.stage("report"):
        page = fit_report.write_report(directory, results, telemetries)
    console.say(f"report: {page}")


def _told_of_replacements(plan: campaigns.Campaign, found: Sequence[Interface]) -> Iterator[str]:
    run = plan.runs[0]
    by_model = {interface.model: interface for interface in found}
    for replacement in plan.replacements:
        interface = by_model[replacement.model]
        names = interface.ignored
        taken = [name for name in interface.settings if name not in names]
        told = f"takes {', '.join(taken) or 'no parameter'}{'; not ' if names else ''}{', '.join(names)}"
        yield f"{replacement.model}: {replacement.archive}, code of its own; {told}"
    if plan.replacements:
        yield "stability is not checked beforehand: the poles are those of our FMUs"
    if untold := sorted(world_of(run).untold(run, placement.ignored(found))):
        yield f"true values not known, left out of /truth: {', '.join(untold)}"


def _telemetry(console: Console, paths: Sequence[Path], directory: Path, *, any_gaps: bool) -> list[Path]:
    """Return telemetry files and folders of them; what maps describe is converted into `directory` first."""
    if any(map(is_map, paths)):
        with console.stage("conversion"):
            paths = convert(paths, directory / "telemetry", any_gaps=any_gaps)
    return [fit_telemetry.inside(path) for path in paths]


def _default_folder(path: Path, suffix: str = "fit") -> Path:
    name = path.resolve().stem if path.is_file() else path.resolve().name
    folder = Path(name)
    # Never beside or over the input.
    return Path(f"{name}-{suffix}") if folder.exists() and folder.resolve() == path.resolve() else folder


def _joint(results: fit_results.Results, path: Path) -> fit_results.Fit:
    """Return the joint fit of earlier results, which must hold it."""
    if results.joint is None:
        raise InputError(f"{path}: joint: missing, expected the joint fit of a calibration")
    return results.joint


def _calibrate(
    console: Console,
    directory: Path,
    paths: Sequence[Path],
    chosen: fit_settings.Settings,
    *,
    own: bool = False,
    calibration: Path | None = None,
    origin: dict[str, str | int | float] | None = None,
    missing: Mapping[str, str] | None = None,
) -> None:
    if calibration is not None:
        known = fit_results.load(calibration)
        _joint(known, calibration)
        origin = {"calibration": str(calibration), "calibration_sha256": files.digest(calibration)}
    with console.stage("reading"):
        telemetries = fit_telemetry.read_all(paths, own=own)
    with console.stage("fit"):
        if calibration is not None:
            results = calibrate_inertial(telemetries, known)
        else:
            results = calibrate(telemetries, chosen)
    results = replace(
        results,
        provenance={
            **results.provenance,
            **(origin or {}),
            "versions": {name: metadata.version(name) for name in VERSIONS},
            "telemetry": [os.path.relpath(t.path, directory) for t in telemetries],
        },
    )
    results = cli_shortfall.told(pulls.with_truth(results, telemetries), missing or {})
    with lock.held(directory):
        fit_results.write(results, directory / "results.json")
        with console.stage("report"):
            page = fit_report.write_report(directory, results, telemetries)
    console.table(results)
    console.document((directory / "results.json").read_text(encoding="utf-8"))
    console.say(f"report: {page}")
    for place, warning in results.unsound:
        raise FitError(f"{directory / 'results.json'}: {place}: {warning.message}")
