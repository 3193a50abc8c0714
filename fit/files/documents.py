"""Text files from anywhere, TOML and JSON: read if they are files of a size that makes sense."""

import re
import tomllib
from pathlib import Path
from typing import Any

from fit.errors import InputError, shown

MAX_SIZE = 2**24  # bytes
MAX_TOML = 2**20  # bytes; what is written by hand
# tomllib takes minutes and gigabytes for a key of thousands of parts
_DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]+[ \t]*\.[ \t]*){100}""")

_NAME = re.compile(r"[\w-]{1,80}")


def text(path: Path, what: str, largest: int = MAX_SIZE) -> str:
    """Return the text of a file.

    Parameters
    ----------
    what : str
        What was expected, for messages: ``"a map"``.
    largest : int
        Size that is refused if exceeded [bytes].

    Raises
    ------
    InputError
        If it cannot be read, is too large or is not UTF-8.
    """
    try:
        if not path.is_file():  # a device may have no end, and a pipe no beginning
            known = "not a file" if path.exists() else "no such file"
            raise InputError(f"{path}: not a readable file ({known}), expected {what}")
        with path.open("rb") as file:
            content = file.read(largest + 1)
        if len(content) > largest:
            raise InputError(f"{path}: larger than {largest} bytes, expected {what}")
        return content.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: not a readable file ({error.strerror}), expected {what}") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: not a readable file (not UTF-8 at byte {error.start}), expected {what}"
        ) from None


def toml(path: Path, what: str) -> dict[str, Any]:
    """Return what a TOML file says; InputError as `text`, or if it is not TOML."""
    content = text(path, what, MAX_TOML)
    if _DEEP_KEY.search(content):
        raise InputError(f"{path}: is nested too deeply, expected {what}")
    try:
        return tomllib.loads(content)
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply, expected {what}") from None
    except ValueError as error:  # of tomllib, or of Python for a number of thousands of digits
        raise InputError(f"{path}: {' '.join(str(error).split())[:200]}, expected {what}") from None


def is_file(path: Path) -> bool:
    """Tell whether there is a file, be its name one that no file can have."""
    try:
        return path.is_file()
    except OSError:
        return False


def key(name: str) -> str:
    """Return a key as it stands, or in quotes and cut if it is no plain name."""
    return name if _NAME.fullmatch(name) else shown(name)


def place(loc: tuple[int | str, ...]) -> str:
    """Return a place in a document as one would write it: ``runs[2].file``."""
    parts = (f"[{p}]" if isinstance(p, int) else f".{key(p)}" for p in loc)
    return "".join(parts).removeprefix(".")
