"""What the commands have in common."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.errors import InputError

CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="The campaign.")]
Out = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results [default: named after the input].")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


@contextmanager
def about(campaign: Path) -> Iterator[None]:
    """Name the campaign file in what is said to be wrong with it."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{campaign}: {error}") from None


def check_folder(path: Path) -> None:
    """Refuse a folder that cannot be made because a file has its name, or that of a folder above it."""
    existing = next(p for p in (path, *path.parents) if p.exists())
    if not existing.is_dir():
        raise InputError(f"{existing}: is a file, expected a folder for the results; name one with --out")
