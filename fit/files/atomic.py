"""Files that appear whole or not at all, also when the process is killed or the power fails.

Nothing is written where a link leads: a folder from elsewhere may hold links in the places where results go.
"""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from fit.errors import FitError, InputError

#: What is made in a folder of results and then written into.
_FOLDERS = ("telemetry", "figures", "fmus", "logs")
#: Files that are opened as they are; all others are replaced whole, and with them a link of their name.
_FILES = (".lock", ".lock-holder", "campaigns.jsonl", "forecast.json")


def temporary(path: Path) -> Path:
    """Return the name under which this process writes ``path``."""
    return path.with_name(f".{path.name}{suffix(os.getpid())}")


def suffix(process: int | str) -> str:
    """Return how the names end under which a process writes, ``"*"`` for any."""
    return f".{process}.part"


def settle(partial: Path, path: Path) -> None:
    """Give a file that is complete its name."""
    with partial.open("rb+") as file:
        os.fsync(file.fileno())
    partial.replace(path)
    if os.name == "posix":  # elsewhere folders cannot be opened
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write(path: Path, content: str | bytes) -> None:
    r"""Write a file at once, text as UTF-8 with the line ends it has.

    A byte in the name of a file that is not UTF-8 is written as its escape, ``\udcff``.

    Raises
    ------
    FitError
        If it cannot be written; what was there before is still there.
    """
    partial = temporary(path)
    try:
        encoded = content.encode(errors="backslashreplace") if isinstance(content, str) else content
        partial.write_bytes(encoded)
        settle(partial, path)
    except OSError as error:
        raise FitError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def write_json(path: Path, document: Mapping[str, object]) -> str:
    """Write results as JSON, which is returned; see `write`.

    Raises
    ------
    FitError
        If a number is not finite: such a result must not look like one.
    """
    try:
        text = json.dumps(document, indent=1, allow_nan=False)
    except ValueError as error:
        raise FitError(f"{path}: not written, a number in the results is not finite") from error
    write(path, text + "\n")
    return text


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
