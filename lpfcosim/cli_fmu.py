"""The commands about FMUs: build, list, validate, export."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from lpfcosim import campaign as campaigns
from lpfcosim import container, network, ssp
from lpfcosim.cli_common import Quiet, about, check_folder
from lpfcosim.console import Console
from lpfcosim.errors import InputError
from lpfcosim.modelica import build as fmu_build
from lpfcosim.modelica import checks

app = typer.Typer(
    help="Build the FMUs from the Modelica sources, list them, check them.", no_args_is_help=True
)


@app.command(name="build")
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
        check_folder(out)
    with console.stage("FMUs"):
        built = fmu_build.build(_models(models), fmi=fmi, force=force)
    if out is not None:
        built = fmu_build.copy(built, out)
    for path in built.values():
        console.say(str(path))


@app.command(name="list")
def fmu_list() -> None:
    """List the models and where their FMUs are, or would be."""
    for model, path in fmu_build.locations().items():
        print(f"{model:18s} {'built    ' if path.is_file() else 'not built'} {path}")


@app.command(name="validate")
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


@app.command(name="export-ssp")
def fmu_export_ssp(
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="Gives the parameters.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="The .ssp file [default: named after it].")
    ] = None,
) -> None:
    """Write the closed loop as SSP 1.0, with one set of parameter values per authority set."""
    plan = campaigns.load(campaign)
    with about(campaign):
        print(ssp.export(plan, fmus(plan, "2.0"), out or Path(f"{campaign.stem}.ssp")))


@app.command(name="container")
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
    with about(campaign):
        print(container.container(runs[run_name], fmus(plan, "2.0"), out or Path(f"{run_name}.fmu")))


def fmus(plan: campaigns.Campaign, fmi: str = "3.0") -> dict[str, Path]:
    """FMUs of a campaign: the user's, and ours in the other places."""
    theirs = {r.model: r.archive for r in plan.replacements}
    ours = [c.model for c in network.every(plan.runs[0]) if c.model not in theirs]
    return {**fmu_build.build(ours, fmi=fmi), **theirs}


def _models(named: Sequence[str] | None) -> Sequence[str]:
    for name in named or ():
        if name not in fmu_build.MODELS:
            raise InputError(f"no model '{name}'; there are {', '.join(fmu_build.MODELS)}")
    return named or fmu_build.MODELS
