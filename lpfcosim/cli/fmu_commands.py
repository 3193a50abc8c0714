"""The commands about FMUs: build, list, export."""

from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli.console import Console
from lpfcosim.cli.options import CampaignFile, Quiet, examples, help_without_command
from lpfcosim.errors import InputError, prefix_errors

app = typer.Typer(
    help="Build, list and export FMUs.",
    epilog=examples("lpfcosim fmu list", "lpfcosim fmu build Plant Actuation --out here"),
    rich_markup_mode=None,
)


@app.callback(invoke_without_command=True)
def _fmu(context: typer.Context) -> None:
    help_without_command(context)


@app.command(epilog=examples("lpfcosim fmu build", "lpfcosim fmu build SuspensionControl --out here"))
def build(
    models: Annotated[
        list[str] | None, typer.Argument(metavar="MODEL", help="Models [default: all].")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to copy the FMUs to.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Build the FMUs from the Modelica sources.

    Models that have not changed are taken from the cache.
    """
    from fit.errors import quote
    from fit.files import closest_match
    from lpfcosim.execution import results_folder
    from lpfcosim.modelica import build as fmu_build
    from lpfcosim.models import fmu_names
    from lpfcosim.workflows import simulate

    console = Console(quiet=quiet)
    if out is not None:
        results_folder.check_folder(out)
    for name in models or ():
        if name not in fmu_names():
            raise InputError(f"no model {quote(name)}{closest_match(name, fmu_names())}")
    built = simulate.build_fmus(models or fmu_names(), console)
    if out is not None:
        built = fmu_build.copy(built, out)
    for path in built.values():
        console.show(str(path))


@app.command(name="list", epilog=examples("lpfcosim fmu list"))
def list_() -> None:
    """List the models and the paths of their FMUs, built or not."""
    from lpfcosim.modelica import build as fmu_build
    from lpfcosim.models import fmu_names

    width = max(map(len, fmu_names()))
    for model, path in fmu_build.locations(fmu_names()).items():
        print(f"{model:{width}} {'built    ' if path.is_file() else 'not built'} {path}")


@app.command(name="export-ssp", epilog=examples("lpfcosim fmu export-ssp mine.toml"))
def export_ssp(
    campaign: CampaignFile,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE.ssp", help="The file [default: named after the campaign]."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Write the closed loop as SSP 1.0.

    It has one set of parameter values for each authority set of the campaign.
    """
    from lpfcosim.campaign import loading
    from lpfcosim.execution import results_folder
    from lpfcosim.export import ssp
    from lpfcosim.workflows import simulate

    console = Console(quiet=quiet)
    plan = loading.load(campaign)
    path = out or Path(f"{campaign.stem}.ssp")
    results_folder.check_file(path, loading.sources(campaign))
    with prefix_errors(campaign):
        archives = simulate.campaign_fmus(plan, console)
        written = ssp.export(plan, archives, path)
    console.show(str(written))
