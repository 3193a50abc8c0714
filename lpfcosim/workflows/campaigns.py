"""The campaign of a workflow, given as such or as the path of its file."""

import math
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from datetime import datetime
from numbers import Real
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import tomlkit

from fit.errors import shown
from lpfcosim.campaign import Campaign, loading
from lpfcosim.errors import InputError

PathLike = str | os.PathLike[str]
CampaignLike = Campaign | PathLike

_CHECKED_ELSEWHERE = ("fit", "design", "identify", "tables")  # by the workflows that use them
_KINDS: dict[Any, type] = {float: Real, tuple: Sequence}
_NAMES = {Real: "a number", int: "an integer", str: "a text", bool: "True or False", Sequence: "a list"}


def load_campaign(path: PathLike) -> Campaign:
    """Read a campaign.

    Raises
    ------
    InputError
        If the file cannot be read or is not a valid campaign. The message gives the place in the file.
    """
    return loading.load(as_path(path, "a campaign file"))


def resolve(campaign: CampaignLike) -> tuple[Campaign, Path | None]:
    """Return a campaign, and its file if it was given as a path.

    Raises
    ------
    InputError
        As `load_campaign`, if it is neither a campaign nor a path, or if one that was changed in Python has a
        number that is not finite or a value of another type.
    """
    if isinstance(campaign, Campaign):
        _check_values(campaign, "campaign", Campaign)
        if not campaign.experiments:
            raise InputError("campaign.experiments: none, expected at least one")
        for place, t0 in (
            ("", campaign.t0),
            *((f"experiments: {e.name}: ", e.t0) for e in campaign.experiments),
        ):
            if t0 is not None and not _is_date(t0):
                raise InputError(f"campaign: {place}t0: {shown(t0)}, expected a date and time of ISO 8601")
        return campaign, None
    path = as_path(campaign, "a Campaign, or the path of its file")
    return loading.load(path), path


def _check_values(value: object, place: str, expected: Any = object) -> None:
    """Refuse numbers that are not finite, and values of another type than the field that holds them."""
    origin, arguments = get_origin(expected) or expected, get_args(expected)
    is_class = isinstance(origin, type) and origin is not UnionType
    kind: type = object if not is_class else _KINDS.get(origin, origin)
    other = {int: bool, Real: bool, Sequence: str}.get(kind, ())  # these are no numbers and no lists
    if not isinstance(value, kind) or isinstance(value, other):
        raise InputError(f"{place}: {shown(value)}, expected {_NAMES.get(kind, kind.__name__)}")
    if isinstance(value, Real) and not math.isfinite(value):
        raise InputError(f"{place}: {shown(value)}, expected a finite number")
    if is_dataclass(value) and not isinstance(value, type):
        types = get_type_hints(type(value))
        for field in fields(value):
            if field.name not in _CHECKED_ELSEWHERE:
                _check_values(getattr(value, field.name), f"{place}.{field.name}", types[field.name])
    elif isinstance(value, Mapping):
        for key, item in value.items():
            _check_values(item, f"{place}[{key!r}]")
    elif isinstance(value, tuple | list):
        for n, item in enumerate(value):
            _check_values(item, f"{place}[{n}]", arguments[0] if Ellipsis in arguments else object)


def _is_date(text: str) -> bool:
    try:
        return datetime.fromisoformat(text) is not None
    except ValueError:
        return False


def is_described_by_file(campaign: Campaign, fmus: Mapping[str, Path] | None = None) -> bool:
    """Return whether a campaign is still as its file has it.

    Parameters
    ----------
    campaign : Campaign
        It may have been changed in Python, or have no file.
    fmus : mapping of str to Path, optional
        Its third-party FMUs by model, wherever they lie now.
    """
    archives = {model: {"path": str(path.resolve())} for model, path in (fmus or {}).items()}
    tables = {**campaign.tables}
    entries = tables.get("fmus", {})
    if not archives.keys() <= entries.keys():
        return False
    if archives:
        tables["fmus"] = {model: {**entry, **archives.get(model, {})} for model, entry in entries.items()}
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        path = Path(folder) / "campaign.toml"
        path.write_text(tomlkit.dumps(tables), encoding="utf-8")
        try:
            described = loading.load(path)
        except InputError:  # a campaign without a file
            return False
    # An FMU may lie elsewhere: of the replacements the digest has the rest.
    is_equal = replace(described, replacements=campaign.replacements) == campaign
    return is_equal and described.digest == campaign.digest


def as_paths(paths: object, expected: str) -> list[Path]:
    """Return one path or several as a list; InputError for what is none, with what was expected."""
    if isinstance(paths, Iterable) and not isinstance(paths, str | bytes):
        return [as_path(path, expected) for path in paths]
    return [as_path(paths, expected)]


def as_path(path: object, expected: str) -> Path:
    """Return a path; InputError if it is none, with what was expected."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{shown(path)}: expected {expected}")
    text = os.fsdecode(path)
    if "\0" in text:
        raise InputError(f"{shown(path)}: expected {expected}, without NUL")
    return Path(text)
