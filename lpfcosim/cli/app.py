"""The commands as a user sees them: names, options, help. Calling a command reads in the code behind it."""

from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli import campaign_commands, fmu_commands, result_commands
from lpfcosim.cli.options import examples, help_without_command

app = typer.Typer(
    help="Calibrate drag-free spacecraft: simulate LISA Pathfinder through FMUs, fit its dynamics, report.",
    epilog=examples(
        "lpfcosim new mine.toml      a campaign to start from",
        "lpfcosim check mine.toml    what to expect of it",
        "lpfcosim run mine.toml      writes mine/report.html",
    ),
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(show_version: bool) -> None:
    if show_version:
        from importlib import metadata

        print(f"lpfcosim {metadata.version('lpfcosim')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context,
    version: Annotated[  # noqa: ARG001 (its callback has it)
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    help_without_command(context)


@app.command(
    epilog=examples(
        "lpfcosim new mine.toml",
        "lpfcosim new --map mission.toml           a map of archives to fill in",
    )
)
def new(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="NAME.toml",
            help="The file to write; the campaign has its name.",
            show_default=False,
        ),
    ] = None,
    as_map: Annotated[
        bool, typer.Option("--map", help="Write a map of archives: CSV, MATLAB, FITS or HDF5.")
    ] = False,
) -> None:
    """Write a commented campaign or map of archives to start from.

    The JSON Schema of the file, lpf-campaign.json or lpf-map.json, is written to the same folder. The first
    line of the file names it, so that editors complete keys and check values as you type. No existing file
    is overwritten.
    """
    from lpfcosim.cli import new as cli_new

    (cli_new.new_map if as_map else cli_new.new)(files or [])


@app.command(epilog=examples("lpfcosim schema > lpf-campaign.json", "lpfcosim schema --map > lpf-map.json"))
def schema(
    as_map: Annotated[bool, typer.Option("--map", help="Print the schema of a map of archives.")] = False,
) -> None:
    """Print the JSON Schema of a campaign or a map, for editors.

    Begin a campaign with the line "#:schema ./lpf-campaign.json", a map with "#:schema ./lpf-map.json".
    Editors then complete and check it as you type, for instance Visual Studio Code with the extension Even
    Better TOML.
    """
    from lpfcosim.cli import schema as cli_schema

    cli_schema.print_schema(as_map=as_map)


app.add_typer(campaign_commands.app)
app.add_typer(result_commands.app)
app.add_typer(fmu_commands.app, name="fmu")
