"""A map, schema ``lpf-map/1``: which columns of which files are the channels of which runs, in what units."""

import re
from datetime import date
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field, ValidationError

from fit.errors import InputError, shown
from fit.files import Table, documents, is_file, key, told
from fit.telemetry.contract import ATTRIBUTES, CHANNELS, REQUIRED, check_root
from fit.units import factor, to_si

_SCHEMA = "lpf-map/1"


class _Table(Table):
    model_config = ConfigDict(strict=True)


class Column(_Table):
    """A column of an archive, and the unit it is in; None: that of the archive, or else of the contract."""

    column: str = Field(min_length=1)
    unit: str | None = None


class Source(_Table):
    """Where a run lies: file, relative to the map, and table in it; its attributes are among the extras."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, object]
    more_keys = re.compile(r"[\s\S]*")  # attributes

    file: str = Field(min_length=1)
    table: str | int | None = None
    run: str = Field(pattern=r"^[^./\\\x00-\x1f][^/\\\x00-\x1f]*$")  # the name of a file, too


class Map(_Table):
    """The file as it is written."""

    schema_: Literal["lpf-map/1"] = Field(alias="schema")
    attributes: dict[str, object] = {}
    channels: dict[str, Column]
    time: Column | None = None
    runs: list[Source] = Field(min_length=1)


def load(path: Path) -> Map:
    """Read a map; what can be told without its archives is checked.

    Raises
    ------
    InputError
        If the file cannot be read or breaks the schema; the message names file, place and what was expected.
    """
    document = documents.toml(path, f"a map of schema {_SCHEMA!r}")
    if document.get("schema") != _SCHEMA:
        stated = shown(document["schema"]) if "schema" in document else "missing"
        raise InputError(f"{path}: schema: {stated}, expected {_SCHEMA!r}")
    try:
        found = Map.model_validate(document)
    except ValidationError as error:
        raise InputError(f"{path}: {told(error)}") from error
    _check_channels(path, found)
    for i, source in enumerate(found.runs):
        attributes = attributes_of(path, found, i)
        if found.time is None and "fs" not in attributes:
            raise InputError(f"{path}: time: missing, expected the column it is in, or an attribute fs")
        check_root(f"{path}: runs[{i}]", {"fs": 1.0, **attributes})
        if not is_file(path.parent / source.file):
            raise InputError(f"{path}: runs[{i}].file: {shown(source.file)}, no such file beside the map")
    return found


def attributes_of(path: Path, found: Map, i: int) -> dict[str, str | int | float]:
    """Return the root attributes of run `i`, those of all runs included, in SI.

    Raises
    ------
    InputError
        If one is not known or its value no such quantity.
    """
    own = {"run": found.runs[i].run, **found.runs[i].__pydantic_extra__}
    places = dict.fromkeys(found.attributes, "attributes") | dict.fromkeys(own, f"runs[{i}]")
    values: dict[str, str | int | float] = {}
    for name, value in {**found.attributes, **own}.items():
        where = f"{path}: {places[name]}.{key(name)}"
        if name not in ATTRIBUTES:
            raise InputError(f"{where}: not known, expected one of {', '.join(ATTRIBUTES)}")
        unit = ATTRIBUTES[name]
        if isinstance(value, date):  # or a datetime, which is one
            value = value.isoformat()
        if not isinstance(value, str | int | float):
            raise InputError(f"{where}: {shown(value)}, expected a number or a text")
        if unit is None:
            values[name] = value
        else:
            try:
                values[name] = to_si(value, unit)
            except ValueError as error:
                told = f"{shown(value)}, {error}"
                raise InputError(f"{where}: {told}, expected a quantity in {unit!r}") from error
    return values


def check_unit(where: str, unit: str | None, si: str) -> float:
    """Return the factor from `unit`, None for `si` itself, to `si`.

    Raises
    ------
    InputError
        If it is not known or measures something else.
    """
    try:
        return 1.0 if unit is None else factor(unit, si)
    except ValueError as error:
        raise InputError(f"{where}: {error}, expected {si or '1'!r} or a multiple of it") from error


def _check_channels(path: Path, found: Map) -> None:
    for name in REQUIRED:
        if name not in found.channels:
            raise InputError(f"{path}: channels.{name}: missing, expected the column it is in")
    for name, column in found.channels.items():
        if name not in CHANNELS:
            place = f"{path}: channels.{key(name)}"
            raise InputError(f"{place}: not known, expected a channel of the contract")
        check_unit(f"{path}: channels.{name}.unit", column.unit, CHANNELS[name].unit)
    if found.time is not None:
        check_unit(f"{path}: time.unit", found.time.unit, "s")
