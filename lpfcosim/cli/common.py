"""What the commands have in common. Every call reads it in, so it imports little."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.errors import InputError

CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="The campaign.")]
Directory = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of an earlier run or fit.")]
Figures = Annotated[
    list[str] | None,
    typer.Argument(metavar="NAME", help="Parts of names of figures [default: all figures]."),
]
Paths = Annotated[
    list[Path], typer.Argument(metavar="PATH", help="Telemetry, folders of it, maps of archives (.toml).")
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Folder for the results [default: named after the input]."),
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
        help="Work on a Dask cluster: its scheduler, such as tcp://HOST:8786 (needs lpfcosim[dask]).",
    ),
]
Trust = Annotated[
    bool,
    typer.Option(
        "--trust", help="For once, let FMUs run that are not ours and not approved (lpfcosim trust)."
    ),
]
Many = list[str] | None  # an option that may be repeated
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors, and JSON if asked for.")]


def examples(*lines: str) -> str:
    """Return what stands at the end of a command's help."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


def help_without_command(context: typer.Context) -> None:
    """Show the help of a group of commands that is called without any, which is a mistake."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(2)


def duration(text: str) -> float:
    """Return a duration [s] from what an option says."""
    from pydantic_core import PydanticCustomError

    from lpfcosim.campaign import units

    try:
        return units.Quantity("a duration", "s", "2 h", sign="positive").to_si(text)
    except PydanticCustomError as error:
        raise typer.BadParameter(str(error)) from None


@contextmanager
def about(campaign: Path) -> Iterator[None]:
    """Name the campaign file in what is said to be wrong with it."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{campaign}: {error}") from None


def check_folder(directory: Path, inside: str = "", option: str = "--out") -> None:
    """Refuse a folder for results that is a link, or cannot be made because a file is in its way.

    `inside` is a folder that will be made in it; `option` names another, if the command has one.
    """
    from fit.files import refuse_links

    refuse_links(directory)
    path = directory / inside
    existing = next((p for p in (path, *path.parents) if _seen(p)), None)
    if existing and not existing.is_dir():
        advice = f"; name one with {option}" if option else ""
        raise InputError(f"{existing}: is a file, expected a folder for the results{advice}")


def _seen(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # in a folder that may not be entered, or of a name that is too long
        return False
