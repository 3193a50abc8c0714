"""A map, schema ``lpf-map/1``: which columns of which files are the channels of which runs, in what units."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import date, time
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field, ValidationError, WrapValidator, model_validator

from fit.errors import InputError, quote, shown
from fit.files import Table, closest_match, documents, is_file, key, problem, validation_messages
from fit.telemetry.archives import Layout
from fit.telemetry.contract import ATTRIBUTES, CHANNELS, check_root, required
from fit.units import factor, to_si

SCHEMA = "lpf-map/1"
#: Time stamps by their names in `astropy.time`; those of ISO 8601 have a T or a blank, whichever it is.
Format = Literal["iso", "isot", "yday", "gps", "unix", "unix_tai", "tai_seconds", "cxcsec", "mjd", "jd"]
Scale = Literal["utc", "tai", "tt", "tdb", "tcg", "tcb"]
#: Formats that count seconds, in a scale of theirs.
SECONDS = ("gps", "unix", "unix_tai", "tai_seconds", "cxcsec")
TIME = "time"  # stands for the time column where a channel is named


def _expected(words: str) -> WrapValidator:
    """Return the validator of a value of several types, which pydantic would report one by one."""

    def validate(raw: object, handler: Any) -> object:
        try:
            return handler(raw)
        except ValidationError:
            raise problem(f"{quote(raw)}, expected {words}") from None

    return WrapValidator(validate)


_Word = Annotated[str, Field(min_length=1)]
_Column = Annotated[
    _Word | Annotated[int, Field(ge=1)],
    _expected('the name of a column, "t", or its number from 1 on'),
    Field(examples=['column = "t"']),
]
_TableKey = Annotated[_Word | int, _expected('the name of a table, "OMS", or its number')]
_Number = Annotated[float, Field(allow_inf_nan=False)]
Missing = Annotated[
    _Number | list[_Number],
    _expected("a number that marks missing samples, or a list of them"),
    AfterValidator(lambda missing: missing if isinstance(missing, list) else [missing]),
]


class _Table(Table):
    model_config = ConfigDict(strict=True)


class Column(_Table):
    """Where a column is, and the unit it is in; None: that of the archive, or else of the contract.

    `file` and `table` replace those of the run.
    """

    unit: str | None = None
    file: _Word | None = None
    table: _TableKey | None = None


class Channel(Column):
    """[channels.X]: the column of a channel and the numbers that mark its missing samples, or one value."""

    column: _Column | None = None
    value: _Number | None = None
    missing: Missing | None = None

    @model_validator(mode="after")
    def _column_or_value(self) -> "Channel":
        has_source = bool(self.column or self.file or self.table or self.missing)
        if (self.column is None) is (self.value is None) or (self.value is not None and has_source):
            raise problem('expected its column, { column = "x1" }, or its only value, { value = 0 }')
        if self.value and self.unit is None:
            raise problem(f"value {self.value:g} without a unit, expected one", "unit")
        return self


class Clock(Column):
    """[time]: seconds from anywhere, or time stamps of a format and a scale, by default UTC."""

    column: _Column
    format: Format | None = None
    scale: Scale | None = None

    @model_validator(mode="after")
    def _unit_or_scale(self) -> "Clock":
        counts = self.format in SECONDS  # in a scale of its own
        for name, value in (
            ("scale", counts and self.scale),
            ("unit", not counts and self.format and self.unit),
        ):
            if value:
                raise problem(f"{quote(value)}, expected none with format {self.format!r}", name)
        return self


class Source(_Table):
    """[[runs]]: where a run is; its attributes are among the extras.

    `file` is relative to the map. In file and table ``{run}`` and ``{channel}`` stand for the names of both.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, object]
    more_keys = re.compile(r"[\s\S]*")  # attributes

    file: Annotated[_Word, Field(examples=['file = "A.csv"'])]
    table: _TableKey | None = None
    run: Annotated[
        str,
        Field(pattern=r"^[^./\\\x00-\x1f][^/\\\x00-\x1f]*$"),
        _expected('the unique name of the run, such as "A1", which names a file'),
        Field(examples=['run = "A"']),
    ]


class Map(_Table):
    """A map of archives: which columns are the channels of which runs, in what units."""

    schema_: Annotated[Literal["lpf-map/1"], Field(alias="schema", examples=[f'schema = "{SCHEMA}"'])]
    missing: Missing = []
    text: Layout = Layout()
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
    for name in (*required(mapping.channels), *mapping.channels):
        place = f"{path}: channels.{key(name)}"
        if name not in mapping.channels:
            value = "; { value = 0 } states that it is known to be zero"
            raise InputError(f'{place}: missing, expected its column, {{ column = "x1" }}{value}')
        if name not in CHANNELS:
            raise InputError(f"{place}: not known{closest_match(name, CHANNELS)}")
        factor_of(f"{place}.unit", mapping.channels[name].unit, name, {"m_tm": 1.0})
    if mapping.time:
        factor_of(f"{path}: time.unit", mapping.time.unit, TIME, {})
    for i in range(len(mapping.runs)):
        attributes = attributes_of(path, mapping, i)
        if mapping.time is None and "fs" not in attributes:
            raise InputError(f"{path}: time: missing, expected the column it is in, or an attribute fs")
        # time stamps say when a run starts
        stamped = {"t0": "2000-01-01T00:00:00Z", "fs": 1.0} if mapping.time else {}
        check_root(f"{path}: runs[{i}]", {**stamped, **attributes})
        columns = [channel for channel in mapping.channels.values() if channel.value is None]
        for column in [*columns, *([mapping.time] if mapping.time and mapping.time.file else [])]:
            archive = place_of(path, mapping, i, column).archive
            if not is_file(archive):
                raise InputError(f"{path}: runs[{i}].file: {archive}: no such file")
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
        if isinstance(value, date | time):  # of TOML; a date with a time is a date
            value = value.isoformat()
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise InputError(f"{place}: {quote(value)}, expected a number or a text")
        unit = ATTRIBUTES[name]
        try:
            values[name] = value if unit is None else to_si(value, unit)
        except ValueError as error:
            raise InputError(f"{place}: {shown(value)}, {error}, expected a quantity in {unit!r}") from error
    return values


def place_of(path: Path, mapping: Map, i: int, column: Column) -> Place:
    """Return the table of run `i` that has a column."""
    run = mapping.runs[i]
    table = run.table if column.table is None else column.table
    channel = next((name for name, known in mapping.channels.items() if known is column), TIME)

    def named(template: str) -> str:
        return template.replace("{run}", run.run).replace("{channel}", channel)

    archive = path.parent / named(column.file or run.file)
    return Place(archive, named(table) if isinstance(table, str) else table)


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
            with suppress(ValueError):
                return factor(unit or "", "N") / float(attributes["m_tm"])
        expected = "'m s-2', 'N'" if channel in ("f_x_1", "f_x_2") else repr(si or "1")
        raise InputError(f"{place}: {error}, expected {expected} or a multiple of it") from error


def template(name: str) -> str:
    """Return the text of a map to fill in, a file `name`."""
    return (Path(__file__).parent / "map-template.toml").read_text(encoding="utf-8").format(name=name)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a map."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Map.model_json_schema()}
