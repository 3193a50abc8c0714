"""What the commands have in common. Every call reads it in, so it imports little."""

from pathlib import Path
from typing import Annotated

import typer

CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="The campaign.")]
Directory = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of an earlier run or fit.")]
Figures = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME", help="Parts of names of figures [default: all figures]."),
]
Paths = Annotated[
    list[Path], typer.Argument(metavar="PATH", help="Telemetry files or folders, maps of archives (.toml).")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the results [default: named after the input]."),
]
Calibration = Annotated[
    Path | None,
    typer.Option("--calibration", metavar="RESULTS", help="An earlier result: its folder or results.json."),
]
Jobs = Annotated[
    int | None,
    typer.Option("--jobs", min=1, metavar="N", help="Processes [default: one per processor]."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Dask scheduler to use, such as tcp://HOST:8786 (needs lpfcosim[dask]).",
    ),
]
Trust = Annotated[
    bool, typer.Option("--trust", help="Let third-party FMUs run: native code with your permissions.")
]
Many = list[str] | None  # an option that may be repeated
Fix = Annotated[Many, typer.Option("--fix", metavar="NAME[=VALUE]", help="Fix a parameter at a value (SI).")]
Tie = Annotated[Many, typer.Option("--tie", metavar="NAME=EXPR", help="Tie a parameter to others.")]
GaussianPrior = Annotated[
    Many, typer.Option("--prior", metavar="NAME=MEAN,SIGMA", help="Prior of a parameter, SI.")
]
Bound = Annotated[Many, typer.Option("--bound", metavar="NAME=MIN:MAX", help="Bounds of a parameter, SI.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors, and JSON if asked for.")]


def examples(*lines: str) -> str:
    """Return what stands at the end of a command's help."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def help_without_command(context: typer.Context) -> None:
    """Show the help of a group of commands that is called without any, which is a mistake."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(2)
