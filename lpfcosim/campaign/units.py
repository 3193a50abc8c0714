"""Quantities of a campaign file: a string with a unit comes in, a float in SI comes out."""

import math
import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from fit import units
from fit.errors import quote
from fit.files import problem

_PER_ROOT_HERTZ = " Hz^-0.5"
_ROOT_HERTZ = re.compile(r"\s*/\s*(?:sqrt\s*\(?\s*Hz\s*\)?|rt\s*\(?\s*Hz\s*\)?|√\s*\(?\s*Hz\s*\)?)\s*")
YEAR = 366 * 86400.0  # s
_SIGNS = {"positive": "above zero", "not negative": "zero or above", "not positive": "zero or below"}


@dataclass(frozen=True)
class Quantity:
    """Annotation of a pydantic float field that is written as a string with a unit.

    Parameters
    ----------
    name : str
        What it is, with its article ("a frequency").
    unit : str
        The SI unit of the value that comes out.
    example : str
        How to write one.
    sign : {"any", "positive", "not negative", "not positive"}
        Which values are allowed.
    smallest, largest : float, optional
        Magnitudes that are plausible, in ``unit``; what lies beyond is a slip, or would overflow later on.
    why : str, optional
        Reason for the sign, appended to the refusal.
    """

    name: str
    unit: str
    example: str
    sign: Literal["any", "positive", "not negative", "not positive"] = "any"
    smallest: float = 0.0
    largest: float = math.inf
    why: str = ""

    def to_si(self, raw: object) -> float:
        """Parse ``raw`` into SI; PydanticCustomError with one sentence if it is not such a quantity."""
        if isinstance(raw, bool | int | float):
            raise problem(f'{quote(raw)} has no unit, write a string with one, such as "{self.example}"')
        if not isinstance(raw, str):
            raise problem(f'expected {self.name} as a string, such as "{self.example}"')
        if units.split(raw) is None:
            raise problem(f'{quote(raw)} is not a number and a unit, write {self.name} like "{self.example}"')
        try:
            value = units.to_si(raw, self.unit)
        except ValueError as error:
            raise problem(f"{quote(raw)} {self._mistaken(raw, error)}") from None
        if not math.isfinite(value):
            raise problem(f"{quote(raw)} is not a finite number")
        allowed = {"positive": value > 0, "not negative": value >= 0, "not positive": value <= 0}
        if not allowed.get(self.sign, True):
            raise problem(f"{quote(raw)} must be {_SIGNS[self.sign]}{self.why and '; '}{self.why}")
        if not self.smallest <= abs(value) <= self.largest:
            bound = f"above {self.largest:g}" if abs(value) > self.largest else f"below {self.smallest:g}"
            raise problem(f"{quote(raw)} is {bound} {self.unit}, which is implausible for {self.name}")
        return value

    def _mistaken(self, raw: str, error: ValueError) -> str:
        """Say what is wrong with the unit."""
        bare = _ROOT_HERTZ.sub("", raw).strip()
        if self.unit.endswith(_PER_ROOT_HERTZ) and _measures(bare, self.unit.removesuffix(_PER_ROOT_HERTZ)):
            return f'is not {self.name}, which is per root hertz: write "{bare}{_PER_ROOT_HERTZ}"'
        if isinstance(error, units.UnknownUnitError):
            return f'has no known unit, write {self.name} like "{self.example}"'
        return f'is not {self.name}, write it like "{self.example}"'

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self.to_si, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        text = f"{self.name} with its unit" + (f", {_SIGNS[self.sign]}" if self.sign != "any" else "")
        return {"type": "string", "description": text, "examples": [self.example]}


def declared_value(raw: object, unit: str) -> float:
    """Return a value in SI of a key that a spacecraft model declares, in its unit, ``""`` for a pure number.

    Raises
    ------
    PydanticCustomError
        If it is no such value; one sentence.
    """
    if unit:
        return Quantity(f"a value in {unit}", unit, f"1 {unit}").to_si(raw)
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not math.isfinite(raw):
        raise problem(f"{quote(raw)} is not a finite number, write it without unit and quotes")
    return float(raw)


def _measures(text: str, unit: str) -> bool:
    try:
        units.to_si(text, unit)
    except ValueError:
        return False
    return True


LENGTH = Quantity("a length", "m", "10 nm", "positive")
FORCE = Quantity("a force", "N", "0.6 pN", "positive", largest=1)
LENGTH_PER_ANGLE = Quantity(
    "a length per angle", "m rad^-1", "10 um/rad", "positive", smallest=1e-12, largest=1
)
_DESTABILISING = "by the sign convention a negative value is destabilising, as in flight"

Stiffness = Annotated[
    float,
    Quantity("a stiffness", "s^-2", "-4.19e-7 s^-2", "not positive", largest=1, why=_DESTABILISING),
]
AlphaX = Annotated[
    float,
    Quantity(
        "a stiffness per force",
        "kg^-1 m^-1",
        "-317 kg^-1 m^-1",
        "not positive",
        largest=1e6,
        why=_DESTABILISING,
    ),
]
AlphaPhi = Annotated[
    float,
    Quantity(
        "a stiffness per torque",
        "kg^-1 m^-2",
        "-27400 kg^-1 m^-2",
        "not positive",
        largest=1e8,
        why=_DESTABILISING,
    ),
]
Frequency = Annotated[float, Quantity("a frequency", "Hz", "0.833 mHz", "positive", 1e-9, 1e3)]
Force = Annotated[float, Quantity("a force", "N", "2200 pN", "not negative", largest=1)]
Torque = Annotated[float, Quantity("a torque", "N m", "10.4 pN m", "not negative", largest=1)]
LengthNoise = Annotated[
    float, Quantity("a length noise", "m Hz^-0.5", "35 fm Hz^-0.5", "not negative", largest=1e-6)
]
ForceNoise = Annotated[
    float, Quantity("a force noise", "N Hz^-0.5", "0.15 uN Hz^-0.5", "not negative", largest=1)
]
AccelerationNoise = Annotated[
    float,
    Quantity("an acceleration noise", "m s^-2 Hz^-0.5", "5.6 fm s^-2 Hz^-0.5", "not negative", largest=1e-3),
]
AngleNoise = Annotated[
    float, Quantity("an angle noise", "rad Hz^-0.5", "0.13 mrad Hz^-0.5", "not negative", largest=1)
]
TorqueNoise = Annotated[
    float, Quantity("a torque noise", "N m Hz^-0.5", "0.08 uN m Hz^-0.5", "not negative", largest=1)
]
RateNoise = Annotated[
    float,
    Quantity(
        "an angular acceleration noise",
        "rad s^-2 Hz^-0.5",
        "1.5e-12 rad s^-2 Hz^-0.5",
        "not negative",
        largest=1e-3,
    ),
]
VoltageNoise = Annotated[
    float, Quantity("a relative noise", "Hz^-0.5", "2e-6 Hz^-0.5", "not negative", largest=1e-2)
]
Rate = Annotated[float, Quantity("a rate", "rad s^-1", "2e-7 rad/s", largest=1e-3)]
Misalignment = Annotated[float, Quantity("an angle", "rad", "-0.47 mrad", largest=0.1)]
LengthPerAngle = Annotated[float, Quantity("a length per angle", "m rad^-1", "12 um/rad", largest=1)]
LengthPerAngleDrift = Annotated[
    float,
    Quantity("a drift of a length per angle", "m rad^-1 s^-1", "0.01 um rad^-1 d^-1", largest=1e-6),
]
CrossStiffness = Annotated[float, Quantity("a stiffness", "s^-2", "1e-7 s^-2", largest=1)]
PerLength = Annotated[float, Quantity("an inverse length", "m^-1", "0.01 m^-1", largest=1e3)]
Time = Annotated[float, Quantity("a time", "s", "900 s", "not negative", largest=YEAR)]
Angle = Annotated[float, Quantity("an angle", "rad", "90 deg", largest=1e6)]
Acceleration = Annotated[float, Quantity("an acceleration", "m s^-2", "1e-11 m s^-2", largest=1)]
