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
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

import fit.errors
from fit import report as fit_report
from fit import results as fit_results
from fit import telemetry as fit_telemetry
from fit.deltag import write_delta_g
from fit.pipeline import calibrate, calibrate_inertial
from lpfcosim import campaign as campaigns
from lpfcosim import container, margins, master, network, placement, runner, ssp, stability
from lpfcosim.console import Console
from lpfcosim.errors import InputError, LpfcosimError, RunError
from lpfcosim.modelica import build as fmu_build
from lpfcosim.modelica import checks
from lpfcosim.spacecraft import Spacecraft


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
fmu_app = typer.Typer(
    help="Build the FMUs from the Modelica sources, list them, check them.", no_args_is_help=True
)
app.add_typer(fmu_app, name="fmu")

Out = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results [default: named after the input].")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


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
    directory = out or Path(campaign.stem)
    _check_folder(directory / "telemetry")
    started = time.perf_counter()
    with _about(campaign):
        for entry in plan.runs if not plan.replacements else ():  # the poles are those of our loop
            stability.check(entry)
    with console.stage("FMUs"):
        fmus = _fmus(plan)
    with _about(campaign):
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
    _calibrate(console, directory, files, include_short=False, origin=origin)


@app.command(name="fit")
def fit_command(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Telemetry files, or folders of them.")
    ],
    out: Out = None,
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
    _check_folder(directory)
    _calibrate(
        Console(quiet=quiet),
        directory,
        [_telemetry_folder(p) for p in paths],
        include_short=include_short,
        calibration=calibration,
    )


@app.command()
def deltag(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Telemetry files, or folders of them.")
    ],
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
    _check_folder(directory)
    results = fit_results.load(calibration)
    joint = _joint(results, calibration)
    inputs = fit_telemetry.files([_telemetry_folder(p) for p in paths])
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


@app.command(name="margins")
def margins_command(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="Gives plant and controllers.")],
) -> None:
    """Print unity gain, phase and gain margin of every control loop, the others being closed."""
    run = campaigns.load(campaign).runs[0]
    with _about(campaign):
        stability.check(run)
    whole = replace(run, spacecraft=run.spacecraft or Spacecraft())
    rows = [m for m in margins.margins(whole) if run.spacecraft or m.loop in ("drag_free_x", "suspension_x")]
    print(f"{'loop':18s} {'unity gain':>12s} {'phase margin':>13s} {'gain margin':>12s}")
    for m in rows:
        print(f"{m.loop:18s} {1e3 * m.unity_gain:8.4g} mHz {m.phase_margin:9.1f} deg {m.gain_margin:9.1f} dB")


@fmu_app.command(name="build")
def fmu_build_command(
    models: Annotated[
        list[str] | None, typer.Argument(metavar="[MODEL]...", help="Models [default: all].")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder to copy the FMUs to.")] = None,
    fmi: Annotated[Literal["2.0", "3.0"], typer.Option("--fmi", help="Version of FMI.")] = "3.0",
    force: Annotated[bool, typer.Option("--force", help="Build again, whatever there is.")] = False,
    quiet: Quiet = False,
) -> None:
    """Build the FMUs from the Modelica sources; what has not changed comes from the cache."""
    console = Console(quiet=quiet)
    if out is not None:
        _check_folder(out)
    with console.stage("FMUs"):
        built = fmu_build.build(_models(models), fmi=fmi, force=force)
    if out is not None:
        built = fmu_build.copy(built, out)
    for path in built.values():
        console.say(str(path))


@fmu_app.command(name="list")
def fmu_list() -> None:
    """List the models and where their FMUs are, or would be."""
    for model, path in fmu_build.locations().items():
        print(f"{model:18s} {'built    ' if path.is_file() else 'not built'} {path}")


@fmu_app.command(name="validate")
def fmu_validate(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="[FMU]...", help="Archives [default: ours].")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Check FMUs with FMPy and with the FMU manipulation toolbox; exit status 1 if a fault is found."""
    console = Console(quiet=quiet)
    faulty = False
    for path in paths or fmu_build.build().values():
        found = checks.problems(path)
        faulty |= bool(found)
        console.say(f"{path}: {'no fault found' if not found else f'{len(found)} faults'}")
        for problem in found:
            print(f"  {problem}", file=sys.stderr)
    if faulty:
        raise typer.Exit(1)


@fmu_app.command(name="export-ssp")
def fmu_export_ssp(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="Gives the parameters.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="The .ssp file [default: named after it].")
    ] = None,
) -> None:
    """Write the closed loop as SSP 1.0, with one set of parameter values per authority set."""
    plan = campaigns.load(campaign)
    with _about(campaign):
        print(ssp.export(plan, _fmus(plan, "2.0"), out or Path(f"{campaign.stem}.ssp")))


@fmu_app.command(name="container")
def fmu_container(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="The campaign of the run.")],
    run_name: Annotated[str, typer.Argument(metavar="RUN", help="The run that gives the parameters.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="The .fmu file [default: named after it].")
    ] = None,
) -> None:
    """Write the closed loop of one run as a single FMU; its inputs are injections and noise."""
    plan = campaigns.load(campaign)
    runs = {r.name: r for r in plan.runs}
    if run_name not in runs:
        raise InputError(f"{campaign}: no run '{run_name}'; there are {', '.join(runs)}")
    with _about(campaign):
        print(container.container(runs[run_name], _fmus(plan, "2.0"), out or Path(f"{run_name}.fmu")))


def _fmus(plan: campaigns.Campaign, fmi: str = "3.0") -> dict[str, Path]:
    """FMUs of a campaign: the user's, and ours in the other places."""
    theirs = {r.model: r.archive for r in plan.replacements}
    ours = [c.model for c in network.every(plan.runs[0]) if c.model not in theirs]
    return {**fmu_build.build(ours, fmi=fmi), **theirs}


@contextmanager
def _held(plan: campaigns.Campaign, fmus: Mapping[str, Path]) -> Iterator[dict[str, Path]]:
    """Copy the FMUs that are not ours, so that all runs use the same whatever happens to the files."""
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        copies = {r.model: Path(folder) / f"{r.model}.fmu" for r in plan.replacements}
        for model, copy in copies.items():
            shutil.copyfile(fmus[model], copy)
        yield {**fmus, **copies}


@contextmanager
def _about(campaign: Path) -> Iterator[None]:
    """Name the campaign file in what is said to be wrong with it."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{campaign}: {error}") from None


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


def _models(named: Sequence[str] | None) -> Sequence[str]:
    for name in named or ():
        if name not in fmu_build.MODELS:
            raise InputError(f"no model '{name}'; there are {', '.join(fmu_build.MODELS)}")
    return named or fmu_build.MODELS


def _check_folder(path: Path) -> None:
    """Refuse a folder that cannot be made because a file has its name, or that of a folder above it."""
    existing = next(p for p in (path, *path.parents) if p.exists())
    if not existing.is_dir():
        raise InputError(f"{existing}: is a file, expected a folder for the results; name one with --out")


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
    *,
    include_short: bool,
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
            results = calibrate(telemetries, include_short=include_short)
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
