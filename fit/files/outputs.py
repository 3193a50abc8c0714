"""Folders for results: nothing is written where a link leads.

A folder from elsewhere may hold links in the places where results go; to write there would change files
that its user never named.
"""

from pathlib import Path

from fit.errors import InputError

#: What is made in a folder of results and then written into.
_FOLDERS = ("telemetry", "figures", "fmus", "logs")
#: Files that are opened as they are; all others are replaced whole, and with them a link of their name.
_FILES = (".lock", ".lock-holder", "campaigns.jsonl", "forecast.json")


def refuse_links(folder: Path) -> None:
    """Refuse a folder for results that is a link, or holds one where results go; above it there may be some.

    Raises
    ------
    InputError
        Names the link.
    """
    inside = [folder / name for name in (*_FOLDERS, *_FILES)]
    try:
        links = [p for p in (folder, *inside, *sorted((folder / "logs").glob("*.log"))) if p.is_symlink()]
    except OSError:  # what may not be looked into is not written to either
        return
    if links:
        raise InputError(
            f"{links[0]}: is a symbolic link, expected a file or folder of its own for the results; remove "
            "it or choose another folder"
        )
