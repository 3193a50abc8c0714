"""The command line; the only place where simulation and estimation meet."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import fit.errors
from fit import report as fit_report
from fit import results as fit_results
from fit import settings as fit_settings
from fit import telemetry as fit_telemetry
from fit.conversion import convert, is_map
from fit.deltag import write_delta_g
from fit.pipeline import calibrate, calibrate_inertial
from lpfcosim import campaign as campaigns
from lpfcosim import (
    cli_fmu,
    cli_mcmc,
    cli_montecarlo,
    cli_plan,
    cli_study,
    master,
    network,
    placement,
    runner,
    stability,
)
from lpfcosim.cli_common import Out, Quiet, about, check_folder
from lpfcosim.console import Console
from lpfcosim.errors import InputError, LpfcosimError, RunError


class _Commands(TyperGroup):
    """The commands; what interrupts one is told like any other error, before typer makes it its own."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise RunError("interrupted; what is finished is kept, the same command continues") from None


app = typer.Typer(
    cls=_Commands,
    help="Calibrate drag-free spacecraft: simulate LISA Pathfinder through FMUs, fit its dynamics, report.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(cli_fmu.app, name="fmu")
app.command(name="mcmc")(cli_mcmc.mcmc_command)
app.command(name="new")(cli_plan.new_command)
app.command(name="check")(cli_plan.check_command)
app.command(name="schema")(cli_plan.schema_command)
app.command(name="margins")(cli_plan.margins_command)
app.command(name="forecast")(cli_study.forecast_command)
app.command(name="montecarlo")(cli_montecarlo.montecarlo_command)

Paths = Annotated[
    list[Path], typer.Argument(metavar="PATH...", help="Telemetry, folders of it, maps of archives (.toml).")
]


def main() -> None:
    """Run the command line: exit status 0 done, 1 the work failed, 2 the input was wrong."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # batch systems end a job with it
    try:
        app()
    except (InputError, fit.errors.InputError) as error:
        _exit(error, 2)
    except (LpfcosimError, fit.errors.CalibrationError) as error:
        _exit(error, 1)
    except OSError as error:
        _exit(f"{error.filename or 'file system'}: {error.strerror or error}", 1)


def _exit(error: object, status: int) -> None:
    print(f"lpfcosim: error: {error}", file=sys.stderr)
    sys.exit(status)


@app.command()
def run(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="The campaign to simulate.")],
    out: Out = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, help="Processes [default: one per processor].")
    ] = None,
    engine: Annotated[
        master.Engine,
        typer.Option("--engine", help="The loop over the FMUs; fmpy: the plain one, slow, same bits."),
    ] = "compiled",
    quiet: Quiet = False,
) -> None:
    """Simulate a campaign with the FMUs, fit it, report; continues what was interrupted.

    The folder holds telemetry/*.h5, results.json, report.html and figures/ afterwards.
    """
    console = Console(quiet=quiet)
    plan = campaigns.load(campaign)
    chosen = fit_settings.settings(plan.fit, f"{campaign}: fit")
    directory = out or Path(campaign.stem)
    check_folder(directory / "telemetry")
    started = time.perf_counter()
    with about(campaign):
        for entry in plan.runs if not plan.replacements else ():  # the poles are those of our loop
            stability.check(entry)
    with console.stage("FMUs"):
        fmus = cli_fmu.fmus(plan)
    with about(campaign):
        for entry in plan.runs:
            placement.interfaces(entry, fmus)
    for line in _told_of_replacements(plan, fmus):
        console.note(line)
    with (
        _held(plan, fmus) as held,
        console.samples({r.name: r.n_samples for r in plan.runs}) as (progress, kept),
    ):
        files = runner.simulate(
            plan, directory / "telemetry", held, jobs=jobs, engine=engine, progress=progress, kept=kept
        )
        for name, n in runner.saturated(files).items():
            console.note(f"run {name}: a command is at its limit in {n} samples, where the fit does not hold")
        simulated = time.perf_counter() - started
        origin = {**runner.provenance(plan, held), "seconds_simulating": round(simulated, 2)}
    _calibrate(console, directory, files, chosen, origin=origin)


@app.command(name="fit")
def fit_command(
    paths: Paths,
    out: Out = None,
    settings: Annotated[
        Path | None,
        typer.Option("--settings", metavar="FIT.toml", help="File with a table [fit], such as a campaign."),
    ] = None,
    include_short: Annotated[
        bool, typer.Option("--include-short", help="Let runs shorter than 6 h take part in the joint fit.")
    ] = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="RESULTS.json",
            help="Take the dynamics from an earlier result; PATH holds noise runs only.",
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Fit telemetry files from anywhere; needs no FMU.

    Sysid runs calibrate the dynamics, noise runs of 12 h or more with torques the inertial forces.
    """
    directory = out or _default_folder(paths[0])
    check_folder(directory / "telemetry")
    chosen = fit_settings.read(settings) if settings else fit_settings.settings()
    if include_short:
        chosen = chosen.model_copy(update={"include_short": True})
    console = Console(quiet=quiet)
    files = _telemetry(console, paths, directory, any_gaps=False)
    _calibrate(console, directory, files, chosen, calibration=calibration)


@app.command()
def deltag(
    paths: Paths,
    calibration: Annotated[
        Path, typer.Option("--calibration", metavar="RESULTS.json", help="Result of an earlier run or fit.")
    ],
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Write the calibrated Delta g of telemetry files as telemetry, every term of it a channel.

    NAME.h5 becomes NAME-deltag.h5: delta_g = delta_g_x + delta_g_SC + g_Omega + g_dOmega, at 1 to 2 Hz.
    """
    console = Console(quiet=quiet)
    directory = out or _default_folder(paths[0], "deltag")
    check_folder(directory / "telemetry")
    results = fit_results.load(calibration)
    joint = _joint(results, calibration)
    inputs = fit_telemetry.files(_telemetry(console, paths, directory, any_gaps=True))
    outputs = {f"{path.stem}-deltag.h5": path for path in inputs}
    for path in inputs:
        if outputs[f"{path.stem}-deltag.h5"] is not path:
            raise InputError(f"{path}: a second file of that name, expected different names")
    origin = {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "calibration_sha256": _digest(calibration),
    }
    directory.mkdir(parents=True, exist_ok=True)
    for name, path in outputs.items():
        with console.stage(str(path)):
            notes = write_delta_g(path, directory / name, results, joint, {**origin, "source": path.name})
        for note in notes:
            console.note(f"warning: {note}")
        console.say(str(directory / name))


@app.command()
def report(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of an earlier run or fit.")],
    quiet: Quiet = False,
) -> None:
    """Rebuild the report from what DIR holds."""
    console = Console(quiet=quiet)
    results = fit_results.load(directory / "results.json")
    recorded = results.provenance.get("telemetry")
    if not isinstance(recorded, list) or not all(isinstance(p, str) for p in recorded):
        raise InputError(f"{directory / 'results.json'}: provenance.telemetry: expected a list of file names")
    telemetries = fit_telemetry.read_all([directory / p for p in recorded])
    with console.stage("report"):
        page = fit_report.write_report(directory, results, telemetries)
    console.say(f"report: {page}")


@contextmanager
def _held(plan: campaigns.Campaign, fmus: Mapping[str, Path]) -> Iterator[dict[str, Path]]:
    """Copy the FMUs that are not ours, so that all runs use the same whatever happens to the files."""
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        copies = {r.model: Path(folder) / f"{r.model}.fmu" for r in plan.replacements}
        for model, copy in copies.items():
            shutil.copyfile(fmus[model], copy)
        yield {**fmus, **copies}


def _told_of_replacements(plan: campaigns.Campaign, fmus: Mapping[str, Path]) -> Iterator[str]:
    run = plan.runs[0]
    ignored = placement.ignored(run, placement.interfaces(run, fmus))
    parameters = network.parameters(run)
    for replacement in plan.replacements:
        names = ignored[replacement.model]
        taken = [name for name in parameters[replacement.model] if name not in names]
        told = f"takes {', '.join(taken) or 'no parameter'}{'; not ' if names else ''}{', '.join(names)}"
        yield f"{replacement.model}: {replacement.archive}, code of its own; {told}"
    if plan.replacements:
        yield "stability is not checked beforehand: the poles are those of our FMUs"
    if untold := sorted(network.untold(run, ignored)):
        yield f"true values not known, left out of /truth: {', '.join(untold)}"


def _telemetry(console: Console, paths: Sequence[Path], directory: Path, *, any_gaps: bool) -> list[Path]:
    """Return telemetry files and folders of them; what maps describe is converted into `directory` first."""
    if any(map(is_map, paths)):
        with console.stage("conversion"):
            paths = convert(paths, directory / "telemetry", any_gaps=any_gaps)
    return [_telemetry_folder(path) for path in paths]


def _telemetry_folder(path: Path) -> Path:
    """Return the folder of telemetry inside the folder of a run, and any other path as it is."""
    inner = path / "telemetry"
    return inner if inner.is_dir() and not any(path.glob("*.h5")) else path


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


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _calibrate(
    console: Console,
    directory: Path,
    paths: Sequence[Path],
    chosen: fit_settings.Settings,
    *,
    calibration: Path | None = None,
    origin: dict[str, str | int | float] | None = None,
) -> None:
    started = time.perf_counter()
    if calibration is not None:
        known = fit_results.load(calibration)
        _joint(known, calibration)
        origin = {"calibration": str(calibration), "calibration_sha256": _digest(calibration)}
    with console.stage("reading"):
        telemetries = fit_telemetry.read_all(paths)
    with console.stage("fit"):
        if calibration is not None:
            results = calibrate_inertial(telemetries, known)
        else:
            results = calibrate(telemetries, chosen)
    directory.mkdir(parents=True, exist_ok=True)
    results = replace(
        results,
        provenance={
            **results.provenance,
            **(origin or {}),
            "telemetry": [os.path.relpath(t.path, directory) for t in telemetries],
            "seconds_fitting": round(time.perf_counter() - started, 2),
        },
    )
    results = fit_results.with_truth(results, telemetries)
    fit_results.write(results, directory / "results.json")
    with console.stage("report"):
        page = fit_report.write_report(directory, results, telemetries)
    console.table(results)
    console.say(f"report: {page}")
