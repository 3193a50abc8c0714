"""What a campaign file says, together with what it extends; FMUs by their path as seen from the file."""

from pathlib import Path
from typing import Any

from fit.errors import quote
from fit.files import documents
from lpfcosim.errors import InputError

_LONGEST_CHAIN = 20  # of files that extend each other


def load(path: Path) -> dict[str, Any]:
    """Return what a file says itself. Raises InputError if it cannot be read or is not TOML."""
    return documents.toml(path, "a campaign file")


def load_extended(path: Path, extending: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return what a file says, on top of what it extends.

    Parameters
    ----------
    path : Path
        The file.
    extending : tuple of Path
        Those that extend it.

    Raises
    ------
    InputError
        If it cannot be read or is not TOML, or extends itself.
    """
    raw = load(path)
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
    chain = (*extending, path.resolve())
    try:
        if beneath.resolve() in chain:
            raise InputError(f"{path}: extends: {quote(base)} extends this file in turn")
        exists = beneath.is_file()
    except (OSError, ValueError):  # a name that no file can have
        exists = False
    if not exists:
        raise InputError(f"{path}: extends: {quote(base)}: no such file")
    if len(chain) > _LONGEST_CHAIN:
        raise InputError(f"{path}: extends: more than {_LONGEST_CHAIN} files, one on top of the other")
    return _deep_merge(load_extended(beneath, chain), raw)


def _deep_merge(base: dict[str, Any], overrides: dict[str, Any]) -> dict[str, Any]:
    """Add to the tables of `base`; values and lists are replaced."""
    merged = base | overrides
    for key, value in overrides.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict):
            merged[key] = _deep_merge(base[key], value)
    return merged
