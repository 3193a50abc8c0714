"""Quantities of a campaign: in a file a string with a unit, in Python a float; SI comes out.

Validation knows a file by its context, the spacecraft model that the file chooses.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    Strict,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic.dataclasses import dataclass as validated_dataclass
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from fit import units
from fit.errors import InputError, quote, shown
from fit.files import closest_match, problem, validation_messages
from lpfcosim.constants import FS, H

Sign = Literal["any", "positive", "not negative", "not positive"]
YEAR = 366 * 86400.0  # s
_RATES = (1.0, 2.0, 5.0, 10.0)  # Hz, at which telemetry may be recorded
_SIGNS = {"positive": "above zero", "not negative": "zero or above", "not positive": "zero or below"}


@dataclass(frozen=True)
class Quantity:
    """Annotation of a float with a dimension.

    Parameters
    ----------
    name : str
        What it is, with its article ("a frequency").
    unit : str
        The SI unit of the value that comes out; ``""`` for a pure number, which is written without quotes.
    example : str
        How to write one.
    sign : {"any", "positive", "not negative", "not positive"}
        Which values are allowed.
    smallest, largest : float, optional
        Magnitudes that are plausible, in ``unit``; what lies beyond is a slip, or would overflow later on.
    """

    name: str
    unit: str
    example: str
    sign: Sign = "any"
    smallest: float = 0.0
    largest: float = math.inf

    def to_si(self, raw: object) -> float:
        """Parse ``raw`` into SI; PydanticCustomError with one sentence if it is not such a quantity."""
        if not self.unit:
            if isinstance(raw, bool) or not isinstance(raw, int | float):
                raise problem(f"{quote(raw)} is not a number, write it without unit and quotes")
            return self._checked(float(raw), raw)
        if isinstance(raw, int | float):
            raise problem(f'{quote(raw)} has no unit, write a string with one, such as "{self.example}"')
        if not isinstance(raw, str):
            raise problem(f'expected {self.name} as a string, such as "{self.example}"')
        if units.split(raw) is None:
            raise problem(f'{quote(raw)} is not a number and a unit, write {self.name} like "{self.example}"')
        try:
            value = units.to_si(raw, self.unit)
        except ValueError as error:
            unknown = "has no known unit" if isinstance(error, units.UnknownUnitError) else "has another unit"
            raise problem(f'{quote(raw)} {unknown}, write {self.name} like "{self.example}"') from None
        return self._checked(value, raw)

    def _checked(self, value: float, raw: object) -> float:
        if not math.isfinite(value):
            raise problem(f"{quote(raw)} is not a finite number")
        allowed = {"positive": value > 0, "not negative": value >= 0, "not positive": value <= 0}
        if not allowed.get(self.sign, True):
            raise problem(f"{quote(raw)} must be {_SIGNS[self.sign]}")
        if not self.smallest <= abs(value) <= self.largest:
            bound = f"above {self.largest:g}" if abs(value) > self.largest else f"below {self.smallest:g}"
            raise problem(f"{quote(raw)} is {bound} {self.unit}, which is implausible for {self.name}")
        return value

    def validate(self, raw: object, info: ValidationInfo) -> float:
        """Return SI of what a file, or Python, gives."""
        if info.context is not None:
            return self.to_si(raw)
        if isinstance(raw, bool) or not isinstance(raw, int | float | np.number):
            raise problem(f"{shown(raw)} is not a number")
        return self._checked(float(raw), raw)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_before_validator_function(self.validate, handler(source))

    def __get_pydantic_json_schema__(self, *_: object) -> dict[str, Any]:
        return self.json_schema()

    def json_schema(self) -> dict[str, Any]:
        """Return what a file may have, as JSON Schema."""
        if not self.unit:
            return {"type": "number"}
        text = f"{self.name} with its unit" + (f", {_SIGNS[self.sign]}" if self.sign != "any" else "")
        return {"type": "string", "description": text, "examples": [self.example]}


def declared_values(raw: Mapping[str, object], known: Mapping[str, Quantity]) -> dict[str, float]:
    """Return the values, SI, of a table with keys that a spacecraft declares.

    Raises
    ------
    PydanticCustomError
        If a key is unknown, or a value no such quantity.
    """
    _check_keys(raw, known)
    values = {}
    for key, value in raw.items():
        try:
            values[key] = known[key].to_si(value)
        except PydanticCustomError as error:
            raise problem(error.message(), key) from None
    return values


@validated_dataclass(frozen=True)
class Record:
    """A table of a campaign file, and what the simulation knows of it: names its keys if one is unknown."""

    @model_validator(mode="wrap")
    @classmethod
    def _input_error(
        cls, raw: object, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        """Raise InputError for a record that is made in Python."""
        try:
            return handler(raw)
        except ValidationError as error:
            if info.context is not None:
                raise
            raise InputError(f"{cls.__name__}: {validation_messages(error, written=False)}") from None

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, raw: object) -> object:
        if isinstance(raw, dict):
            _check_keys(raw, cls.__pydantic_fields__)  # type: ignore[attr-defined]
        return raw


def _check_keys(raw: Iterable[object], known: Collection[str]) -> None:
    for key in raw:
        if key not in known:
            raise problem(f"unknown key{closest_match(str(key), known)}", str(key))


def _whole_samples(seconds: float) -> float:
    samples = round(seconds * FS)
    if abs(seconds * FS - samples) > 1e-6:
        raise problem(f"{seconds:g} s is not a whole number of {H:g} s samples")
    return samples / FS


def _below_nyquist(frequency: float) -> float:
    if frequency >= FS / 2:
        raise problem(f"{frequency:g} Hz is not below the Nyquist frequency, {FS / 2:g} Hz")
    return frequency


def _recorded(rate: float) -> float:
    if rate not in _RATES:
        raise problem(f"{rate:g} Hz is no rate to record at, choose 1, 2, 5 or 10 Hz")
    return rate


def _utc(raw: object) -> datetime:
    try:
        when = raw if isinstance(raw, datetime) else datetime.fromisoformat(str(raw))
    except ValueError:
        when = datetime.min
    if when.utcoffset() != timedelta(0) or not 1990 <= when.year < 2100:
        raise problem(f'{quote(raw)} is not a time in UTC, write it as in "2016-04-16T08:00:00Z"')
    return when.astimezone(UTC)


def _usable(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", name) or name.endswith("."):
        raise problem(f'{quote(name)} cannot name a file, use up to 64 letters, digits, "-", "_" and "."')
    if re.fullmatch(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", name.casefold()):
        raise problem(f"{quote(name)} cannot name a file on every system, choose another name")
    return name


LENGTH = Quantity("a length", "m", "10 nm", "positive")
FORCE = Quantity("a force", "N", "0.6 pN", "positive", largest=1)
Frequency = Annotated[float, Quantity("a frequency", "Hz", "0.833 mHz", "positive", 1e-9, 1e3)]
BelowNyquist = Annotated[Frequency, AfterValidator(_below_nyquist)]
SampleRate = Annotated[Frequency, AfterValidator(_recorded)]
Force = Annotated[float, Quantity("a force", "N", "2200 pN", "not negative", largest=1)]
Torque = Annotated[float, Quantity("a torque", "N m", "10.4 pN m", "not negative", largest=1)]
Time = Annotated[float, Quantity("a time", "s", "900 s", "not negative", largest=YEAR)]
Duration = Annotated[Time, AfterValidator(_whole_samples)]
Angle = Annotated[float, Quantity("an angle", "rad", "90 deg", largest=1e6)]
Acceleration = Annotated[float, Quantity("an acceleration", "m s^-2", "1e-11 m s^-2", largest=1)]
AccelerationNoise = Annotated[
    float,
    Quantity("an acceleration noise", "m s^-2 Hz^-0.5", "5.6 fm s^-2 Hz^-0.5", "positive", largest=1e-3),
]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Utc = Annotated[datetime, BeforeValidator(_utc)]
#: Of campaigns, experiments and runs, which become names of files.
Name = Annotated[str, Strict(), AfterValidator(_usable)]
