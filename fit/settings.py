"""What a user may choose about a fit: table ``[fit]`` of a campaign or of a file of settings."""

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from fit.errors import InputError, shown
from fit.files import documents

Estimator = Literal["gaussian", "student_t", "marginalised", "flscov"]  # of the likelihood, or LTPDA's
Group = Literal["campaign", "alignment_epoch", "experiment"]  # over which a parameter has one value
_Scattering = Literal["lambda_1", "lambda_2", "C_1", "C_2"]


class Settings(BaseModel):
    """The choices, as ``fit/default.toml`` explains them."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    estimator: Estimator
    include_short: bool
    exclude: list[str]
    glitches: bool
    scatter: list[_Scattering]
    shared: dict[str, Group]


_EXPECTED = {
    "list_type": "a list in brackets",
    "bool_type": "true or false",
    "string_type": "a text in quotes",
}


def _told(fault: ErrorDetails) -> str:
    """Say what pydantic found at fault in a key of [fit] or its value."""
    if fault["type"] == "extra_forbidden":
        return f"not known{_among(str(fault['loc'][-1]), Settings.model_fields)}"
    given, kind = fault["input"], fault["type"]
    if kind == "literal_error":
        known = re.findall(r"'([^']*)'", fault["ctx"]["expected"])
        return f"{shown(given)} is not known{_among(str(given), known)}"
    return f"{shown(given)}, expected {_EXPECTED[kind]}" if kind in _EXPECTED else fault["msg"]


def _among(name: str, known: Iterable[str]) -> str:
    """Say which name was probably meant, or which there are."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f", did you mean {close[0]}?" if close else f", expected one of {', '.join(known)}"


def _default() -> dict[str, object]:
    text = resources.files("fit").joinpath("default.toml").read_text(encoding="utf-8")
    table: dict[str, object] = tomllib.loads(text)["fit"]
    return table


def settings(chosen: Mapping[str, object] | None = None, where: str = "[fit]") -> Settings:
    """Return the settings with what is chosen on top of the default.

    Parameters
    ----------
    chosen : mapping, optional
        A table ``[fit]``, in part or whole.
    where : str
        The place it was found at, for messages.

    Raises
    ------
    InputError
        If a key or a value is not known.
    """
    chosen, default = dict(chosen or {}), _default()
    shared, known = chosen.pop("shared", {}), default.pop("shared")
    if not isinstance(shared, Mapping) or not isinstance(known, dict):
        raise InputError(f"{where}.shared: {shown(shared)}, expected a table of parameters")
    for name in shared:
        if name not in known:
            raise InputError(f"{where}.shared.{documents.key(name)}: not known{_among(name, known)}")
    try:
        found = Settings.model_validate({**default, **chosen, "shared": {**known, **shared}})
    except ValidationError as error:
        fault = error.errors()[0]
        raise InputError(f"{where}.{documents.place(fault['loc'])}: {_told(fault)}") from error
    if len(set(found.scatter)) < len(found.scatter):
        raise InputError(f"{where}.scatter: {', '.join(found.scatter)}: expected each parameter once")
    for name in found.scatter:
        if found.shared[name] != "campaign":
            raise InputError(
                f"{where}.scatter: {name} has a value for each {found.shared[name]} already, "
                'expected shared = "campaign"'
            )
    return found


def read(path: Path) -> Settings:
    """Read the settings in a TOML file with a table ``[fit]``, be it a campaign or not.

    Raises
    ------
    InputError
        If the file cannot be read, has no such table or breaks it.
    """
    table = documents.toml(path, "a file of settings").get("fit")
    if not isinstance(table, dict):
        raise InputError(f"{path}: no table [fit], expected one with the settings of the fit")
    return settings(table, f"{path}: fit")
