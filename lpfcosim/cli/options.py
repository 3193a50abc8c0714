"""What the commands have in common. Every call reads it in, so it imports little."""

import os
from collections.abc import Iterable, Sequence
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
Fix = Annotated[Many, typer.Option("--fix", metavar="NAME[=VALUE]", help="Fix a parameter, SI.")]
Tie = Annotated[Many, typer.Option("--tie", metavar="NAME=EXPR", help="Tie a parameter to others.")]
GaussianPrior = Annotated[
    Many, typer.Option("--prior", metavar="NAME=MEAN,SIGMA", help="Prior of a parameter, SI.")
]
Bound = Annotated[Many, typer.Option("--bound", metavar="NAME=MIN:MAX", help="Bounds of a parameter, SI.")]
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


def check_folder(directory: Path, inside: str = "", option: str = "--out") -> None:
    """Refuse a folder for results that is a link, or cannot be made or written to.

    `inside` is a folder that will be made in it; `option` names another, if the command has one.
    """
    from fit.files import refuse_links

    refuse_links(directory)
    path = directory / inside
    existing = next((p for p in (path, *path.parents) if _exists(p)), None)
    advice = f"; name one with {option}" if option else ""
    if existing and not existing.is_dir():
        raise InputError(f"{existing}: is a file, expected a folder for the results{advice}")
    if existing and not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{existing}: may not be written to, expected a folder for the results{advice}")


def check_file(
    path: Path, inputs: Iterable[Path], suffixes: Sequence[str] = (), *, parents: bool = False
) -> None:
    """Refuse a file to be written that will not be possible; to be called before any work is done.

    Parameters
    ----------
    path : Path
        The file.
    inputs : iterable of Path
        Files that are read, which it must not replace.
    suffixes : sequence of str
        How its name may end, such as ``.toml``; without any as it likes.
    parents : bool
        Whether folders that are missing will be made.

    Raises
    ------
    InputError
        If its name ends otherwise, it is a folder or an input, or it or its folder may not be written.
    """
    if suffixes and path.suffix not in suffixes:
        example = f", such as {path.with_suffix(suffixes[0])}" if path.name else ""
        raise InputError(f"{path}: expected a name that ends in {', '.join(suffixes)}{example}")
    folder = path.parent
    if parents:
        folder = next((p for p in (folder, *folder.parents) if _exists(p)), folder)
    if not folder.is_dir():
        raise InputError(f"{path}: {folder} is not a folder, expected one that is there")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, expected the name of a file")
    if any(_is_same_file(path, input_path) for input_path in inputs):
        raise InputError(f"{path}: is read by this command, expected another name")
    for place in (folder, path):
        if _exists(place) and not os.access(place, os.W_OK):
            raise InputError(f"{path}: {place} may not be written to, expected another name")


def _is_same_file(path_1: Path, path_2: Path) -> bool:
    return path_1.resolve() == path_2.resolve() or (
        _exists(path_1) and _exists(path_2) and path_1.samefile(path_2)
    )


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # in a folder that may not be entered, or of a name that is too long
        return False
