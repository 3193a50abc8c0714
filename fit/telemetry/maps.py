"""A map, schema ``lpf-map/1``: which columns of which files are the channels of which runs, in what units."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date, time
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from fit.errors import InputError, quote, shown
from fit.files import Table, closest_match, documents, is_file, key, problem, validation_messages
from fit.telemetry.contract import ATTRIBUTES, CHANNELS, check_root, required
from fit.units import factor, to_si

SCHEMA = "lpf-map/1"
#: Time stamps by their names in `astropy.time`; those of ISO 8601 have a T or a blank, whichever it is.
Format = Literal["iso", "isot", "yday", "gps", "unix", "unix_tai", "tai_seconds", "cxcsec", "mjd", "jd"]
Scale = Literal["utc", "tai", "tt", "tdb", "tcg", "tcb"]
SECONDS = (
    "gps",
    "unix",
    "unix_tai",
    "tai_seconds",
    "cxcsec",
)  # formats that count them, in a scale of theirs
TIME = "time"  # stands for the time column where a channel is named
_RUN = re.compile(r"[^./\\\x00-\x1f][^/\\\x00-\x1f]*")  # the name of a file, too


def _is_number(raw: object) -> bool:
    return isinstance(raw, int | float) and not isinstance(raw, bool)


def _column(raw: object) -> object:
    if (isinstance(raw, str) and raw) or (isinstance(raw, int) and _is_number(raw) and raw >= 1):
        return raw
    raise problem(f'{quote(raw)} is no column, expected its name, "t", or its number from 1 on')


def _table(raw: object) -> object:
    if (isinstance(raw, str) and raw) or (isinstance(raw, int) and _is_number(raw)):
        return raw
    raise problem(f'{quote(raw)} is no table, expected its name, "OMS", or its number')


def _file(raw: object) -> object:
    if isinstance(raw, str) and raw:
        return raw
    raise problem(f'{quote(raw)} is no file, expected its name, "A.csv"')


def _files(raw: object) -> object:
    several = raw if isinstance(raw, list) else list(raw.values()) if isinstance(raw, dict) else [raw]
    if several and all(isinstance(name, str) and name for name in several):
        return raw
    names = 'a name, "A.csv", a list of them, or a table channel = file'
    raise problem(f"{quote(raw)} is no file, expected {names}")


def _missing(raw: Any) -> object:
    several = raw if isinstance(raw, list) else [raw]
    if all(map(_is_number, several)):
        try:
            return [float(marker) for marker in several]
        except OverflowError:
            raise problem(f"{quote(raw)} is larger than any float, expected a number of a file") from None
    raise problem(
        f"{quote(raw)} is no number, expected a number that marks missing samples, or a list of them"
    )


def _run(raw: object) -> object:
    if isinstance(raw, str) and _RUN.fullmatch(raw):
        return raw
    raise problem(f'{quote(raw)} cannot name a file, expected the unique name of the run, such as "A1"')


Missing = Annotated[list[float], BeforeValidator(_missing, json_schema_input_type=float | list[float])]
_Number = Annotated[int, Field(ge=1)]
_ColumnKey = Annotated[str | int, BeforeValidator(_column, json_schema_input_type=str | _Number)]
_TableKey = Annotated[str | int, BeforeValidator(_table, json_schema_input_type=str | int)]
_Files = str | list[str] | dict[str, str]


class _Table(Table):
    model_config = ConfigDict(strict=True)


class Column(_Table):
    """Where a column is, and the unit it is in; None: that of the archive, or else of the contract.

    `file` and `table` replace those of the run.
    """

    column: Annotated[_ColumnKey, Field(examples=['column = "t"'])]
    unit: str | None = None
    file: Annotated[str, BeforeValidator(_file)] | None = None
    table: _TableKey | None = None


class Channel(Column):
    """[channels.X]: the column of a channel and the numbers that mark its missing samples, or one value."""

    column: _ColumnKey | None = None  # type: ignore[assignment]  # None with a value
    value: Annotated[float, Field(allow_inf_nan=False)] | None = None
    missing: Missing | None = None

    @model_validator(mode="after")
    def _column_or_value(self) -> "Channel":
        if (self.column is None) is (self.value is None):
            raise problem('expected its column, { column = "x1" }, or its only value, { value = 0 }')
        if self.value is not None and (self.file or self.table or self.missing):
            raise problem("a value has no file, table or missing samples, expected a unit at most")
        if self.value and self.unit is None:
            raise problem(f"value {self.value:g} without a unit, expected one", "unit")
        return self


class Clock(Column):
    """[time]: seconds from anywhere, or time stamps of a format and a scale, by default UTC."""

    format: Format | None = None
    scale: Scale | None = None


class Source(_Table):
    """[[runs]]: where a run is; its attributes are among the extras.

    `file` is relative to the map. A list of files is searched for the columns; a table has the file of each
    channel, and of ``time``. In file and table ``{run}`` and ``{channel}`` stand for the names of both.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, object]
    more_keys = re.compile(r"[\s\S]*")  # attributes

    file: Annotated[
        _Files,
        BeforeValidator(_files, json_schema_input_type=_Files),
        Field(examples=['file = "A.csv"']),
    ]
    table: _TableKey | None = None
    run: Annotated[str, BeforeValidator(_run), Field(examples=['run = "A"'])]


class Map(_Table):
    """A map of archives: which columns are the channels of which runs, in what units."""

    schema_: Annotated[Literal["lpf-map/1"], Field(alias="schema", examples=[f'schema = "{SCHEMA}"'])]
    missing: Missing = []
    attributes: dict[str, object] = {}
    channels: Annotated[dict[str, Channel], Field(examples=["[channels] …"])]
    time: Clock | None = None
    runs: Annotated[list[Source], Field(min_length=1, examples=["[[runs]] …"])]


@dataclass(frozen=True)
class Place:
    """A table of an archive; None: the first of the file, or all that it has."""

    archive: Path
    table: str | int | None


def load(path: Path) -> Map:
    """Read a map; what needs none of its archives is checked.

    Raises
    ------
    InputError
        If the file cannot be read or breaks the schema; the message names file, place and what was expected.
    """
    document = documents.toml(path, f"a map of schema {SCHEMA!r}")
    if document.get("schema") != SCHEMA:
        stated = shown(document["schema"]) if "schema" in document else "missing"
        raise InputError(f"{path}: schema: {stated}, expected {SCHEMA!r}")
    try:
        mapping = Map.model_validate(document)
    except ValidationError as error:
        raise InputError(f"{path}: {validation_messages(error)}") from error
    _check_channels(path, mapping)
    _check_clock(path, mapping.time)
    for i in range(len(mapping.runs)):
        attributes = attributes_of(path, mapping, i)
        if mapping.time is None:
            if "fs" not in attributes:
                raise InputError(f"{path}: time: missing, expected the column it is in, or an attribute fs")
        else:  # time stamps say when a run starts
            attributes.setdefault("t0", "2000-01-01T00:00:00Z")
        check_root(f"{path}: runs[{i}]", {"fs": 1.0, **attributes})
        _check_files(path, mapping, i)
    return mapping


def attributes_of(path: Path, mapping: Map, i: int) -> dict[str, str | int | float]:
    """Return the root attributes of run `i`, those of all runs included, in SI.

    Raises
    ------
    InputError
        If one is not known or its value no such quantity.
    """
    of_run = {"run": mapping.runs[i].run, **mapping.runs[i].__pydantic_extra__}
    places = dict.fromkeys(mapping.attributes, "attributes") | dict.fromkeys(of_run, f"runs[{i}]")
    values: dict[str, str | int | float] = {}
    for name, value in {**mapping.attributes, **of_run}.items():
        place = f"{path}: {places[name]}.{key(name)}"
        if name not in ATTRIBUTES:
            raise InputError(f"{place}: not known{closest_match(name, ATTRIBUTES)}")
        unit = ATTRIBUTES[name]
        if isinstance(value, date | time):  # of TOML; a date with a time is a date
            value = value.isoformat()
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise InputError(f"{place}: {quote(value)}, expected a number or a text")
        if unit is None:
            values[name] = value
        else:
            try:
                values[name] = to_si(value, unit)
            except ValueError as error:
                reason = f"{shown(value)}, {error}"
                raise InputError(f"{place}: {reason}, expected a quantity in {unit!r}") from error
    return values


def places_of(path: Path, mapping: Map, i: int, channel: str) -> list[Place]:
    """Return the tables of run `i` that may have the column of a channel, or of `TIME`.

    Raises
    ------
    InputError
        If the run has no file for it.
    """
    source = mapping.runs[i]
    column = mapping.time if channel == TIME else mapping.channels[channel]
    assert column is not None
    if column.file is not None:
        names: list[str] = [column.file]
    elif isinstance(source.file, dict):
        if channel not in source.file:
            raise InputError(
                f"{path}: runs[{i}].file.{key(channel)}: missing, expected the file of its column"
            )
        names = [source.file[channel]]
    else:
        names = source.file if isinstance(source.file, list) else [source.file]
    table = source.table if column.table is None else column.table

    def named(template: str) -> str:
        return template.replace("{run}", source.run).replace("{channel}", channel)

    chosen = named(table) if isinstance(table, str) else table
    return [Place(path.parent / named(name), chosen) for name in dict.fromkeys(names)]


def has_common_clock(mapping: Map, i: int) -> bool:
    """Return whether the time of run `i` has one stated place, not one in each table of channels."""
    source, clock = mapping.runs[i], mapping.time
    if clock is None or clock.file is not None or clock.table is not None:
        return True
    return isinstance(source.file, dict) and TIME in source.file


def places_of_run(path: Path, mapping: Map, i: int) -> Iterator[Place]:
    """Yield the tables of run `i`, each once."""
    names = [
        *(name for name, channel in mapping.channels.items() if channel.value is None),
        *([TIME] if mapping.time is not None and has_common_clock(mapping, i) else []),
    ]
    yield from dict.fromkeys(place for name in names for place in places_of(path, mapping, i, name))


def factor_of(place: str, unit: str | None, channel: str, attributes: Mapping[str, Any]) -> float:
    """Return the factor from `unit`, None for that of the contract, to the unit of a channel or of the time.

    A force may stand for the force per unit mass.

    Raises
    ------
    InputError
        If the unit is not known or measures something else.
    """
    si = "s" if channel == TIME else CHANNELS[channel].unit
    try:
        return 1.0 if unit is None else factor(unit, si)
    except ValueError as error:
        if channel in ("f_x_1", "f_x_2"):
            try:
                return factor(unit or "", "N") / float(attributes["m_tm"])
            except ValueError:
                raise InputError(f"{place}: {error}, expected {si!r}, 'N' or a multiple of one") from error
        raise InputError(f"{place}: {error}, expected {si or '1'!r} or a multiple of it") from error


def _check_channels(path: Path, mapping: Map) -> None:
    for name in required(mapping.channels):
        if name not in mapping.channels:
            raise InputError(f"{path}: channels.{name}: missing, expected the column it is in")
    for name, column in mapping.channels.items():
        if name not in CHANNELS:
            place = f"{path}: channels.{key(name)}"
            raise InputError(f"{place}: not known, expected a channel of the contract")
        factor_of(f"{path}: channels.{name}.unit", column.unit, name, {"m_tm": 1.0})


def _check_clock(path: Path, clock: Clock | None) -> None:
    if clock is None:
        return
    if clock.format is None or clock.format in SECONDS:
        factor_of(f"{path}: time.unit", clock.unit, TIME, {})
    elif clock.unit is not None:
        raise InputError(
            f"{path}: time.unit: {shown(clock.unit)}, expected none with format {clock.format!r}"
        )
    if clock.format in SECONDS and clock.scale is not None:
        raise InputError(
            f"{path}: time.scale: {clock.scale!r}, expected none: {clock.format!r} has a scale of its own"
        )


def _check_files(path: Path, mapping: Map, i: int) -> None:
    files = mapping.runs[i].file
    if isinstance(files, dict):
        for name in files:
            if name not in mapping.channels and (name != TIME or mapping.time is None):
                known = [*mapping.channels, TIME]
                raise InputError(f"{path}: runs[{i}].file.{key(name)}: not known{closest_match(name, known)}")
    for place in places_of_run(path, mapping, i):
        if not is_file(place.archive):
            name = str(place.archive).removeprefix(f"{path.parent}/")
            raise InputError(f"{path}: runs[{i}].file: {shown(name)}, no such file in the folder of the map")
