"""What a campaign file says, together with what it extends; FMUs by their path as seen from the file."""

import re
import tomllib
from pathlib import Path
from typing import Any

from lpfcosim.errors import InputError
from lpfcosim.messages import quote, toml_problem

_MAX_SIZE = 2**20  # bytes
_LONGEST_CHAIN = 20  # of files that extend each other
# tomllib takes minutes and gigabytes for a key of thousands of parts
_DEEP_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]+[ \t]*\.[ \t]*){100}""")


def read(path: Path, below: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return what a file says, on top of what it extends.

    Parameters
    ----------
    path : Path
        The file.
    below : tuple of Path
        Those that extend it.

    Raises
    ------
    InputError
        If it cannot be read or is not TOML, or extends itself.
    """
    raw = _raw(path)
    fmus = raw.get("fmus")
    for entry in fmus.values() if isinstance(fmus, dict) else ():
        if isinstance(entry, dict) and isinstance(entry.get("path"), str) and entry["path"]:
            entry["path"] = str(path.parent / entry["path"])  # as seen from the file that says it
    if "extends" not in raw:
        return raw
    base = raw["extends"]
    if not isinstance(base, str) or not base:
        raise InputError(f"{path}: extends: {quote(base)} is not the name of a campaign file")
    beneath = path.parent / base
    chain = (*below, path.resolve())
    try:
        if beneath.resolve() in chain:
            raise InputError(f"{path}: extends: {quote(base)} extends this file in turn")
        found = beneath.is_file()
    except (OSError, ValueError):  # a name that no file can have
        found = False
    if not found:
        raise InputError(f"{path}: extends: {quote(base)}: no such file")
    if len(chain) > _LONGEST_CHAIN:
        raise InputError(f"{path}: extends: more than {_LONGEST_CHAIN} files, one on top of the other")
    return _onto(read(beneath, chain), raw)


def _onto(base: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Add to the tables of `base`; values and lists are replaced."""
    both = {
        key: _onto(base[key], value) if isinstance(value, dict) and isinstance(base.get(key), dict) else value
        for key, value in more.items()
    }
    return base | both


def _raw(path: Path) -> dict[str, Any]:
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder, expected a campaign file")
        if path.exists() and not path.is_file():  # a device may have no end, and a pipe no beginning
            raise InputError(f"{path}: is not a file, expected a campaign file")
        with path.open("rb") as file:
            content = file.read(_MAX_SIZE + 1)
        if len(content) > _MAX_SIZE:
            raise InputError(f"{path}: is larger than {_MAX_SIZE} bytes, expected a campaign file")
        text = content.decode("utf-8-sig")
        if _DEEP_KEY.search(text):
            raise InputError(f"{path}: is nested too deeply")
        return tomllib.loads(text)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start}), expected a TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: {toml_problem(str(error))}") from None
    except ValueError:  # what is left: Python refuses to convert thousands of digits
        raise InputError(f"{path}: holds a number of too many digits") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
