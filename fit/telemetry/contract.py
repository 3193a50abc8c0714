"""The telemetry contract, schema ``lpf-telemetry/1``: channels and root attributes of a file, with units."""

import math
from collections.abc import Container, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, ValidationError

from fit.errors import InputError, shown
from fit.files import problem, validation_messages

SCHEMA = "lpf-telemetry/1"


class Channel(NamedTuple):
    """Unit of a channel, ``""`` for a pure number, and what the channel is."""

    unit: str
    long_name: str


_AXES, _ANGLES = ("x", "y", "z"), ("theta", "eta", "phi")


def _each(name: str, unit: str, long_name: str, *values: object) -> dict[str, Channel]:
    """Return a channel for each value, which stands for the braces."""
    return {name.format(value): Channel(unit, long_name.format(value)) for value in values}


CHANNELS: Mapping[str, Channel] = {
    "o_1": Channel("m", "interferometer read-out of x_1, test mass 1 relative to the spacecraft"),
    "o_12": Channel("m", "interferometer read-out of x_2 - x_1"),
    "o_2": Channel("m", "LISA: interferometer read-out of x_2, test mass 2 relative to the spacecraft"),
    **_each("dws_phi_{}", "rad", "LISA: long-range wavefront sensing of phi by assembly {}", 1, 2),
    **_each("mosa_{}", "rad", "LISA: yaw of assembly {} from its nominal direction", 1, 2),
    **_each("X_{}", "m", "LISA: motion of housing {0} along its telescope, by a long arm, plus o_{0}", 1, 2),
    **_each("f_x_{}", "m s-2", "commanded force on test mass {} along x per unit mass", 1, 2),
    "guidance_o_1": Channel("m", "guidance injected into the drag-free loop"),
    "guidance_o_12": Channel("m", "guidance injected into the suspension loop"),
    **_each("F_{}_sc", "N", "commanded thrust on the spacecraft along {}", *_AXES),
    **_each("N_{}_sc", "N m", "commanded torque on the spacecraft about {}", *_AXES),
    "o_phi_1": Channel("rad", "wavefront-sensing read-out of phi, test mass 1"),
    "o_phi_12": Channel("rad", "wavefront-sensing read-out of phi, test mass 2 less test mass 1"),
    "o_eta_1": Channel("rad", "wavefront-sensing read-out of eta, test mass 1"),
    "o_eta_12": Channel("rad", "wavefront-sensing read-out of eta, test mass 2 less test mass 1"),
    **_each("grs_{}_1", "m", "capacitive read-out of {}, test mass 1", *_AXES),
    **_each("grs_{}_1", "rad", "capacitive read-out of {}, test mass 1", *_ANGLES),
    **_each("grs_{}_2", "m", "capacitive read-out of {}, test mass 2", *_AXES),
    **_each("grs_{}_2", "rad", "capacitive read-out of {}, test mass 2", *_ANGLES),
    **_each("F_{}_1", "N", "commanded force on test mass 1 along {}", *_AXES),
    **_each("F_{}_2", "N", "commanded force on test mass 2 along {}", *_AXES),
    **_each("N_{}_1", "N m", "commanded torque on test mass 1, angle {}", *_ANGLES),
    **_each("N_{}_2", "N m", "commanded torque on test mass 2, angle {}", *_ANGLES),
    **_each("ast_{}", "rad", "star-tracker attitude against J2000, angle {}", *_ANGLES),
    **_each("ast_q_{}", "", "star-tracker quaternion J2000 to body, component {}, scalar last", 1, 2, 3, 4),
}
#: The channel that holds the set points of a read-out, by the read-out.
GUIDANCE: Mapping[str, str] = {
    **{name: f"guidance_{name}" for name in ("o_1", "o_2", "o_12")},
    **{f"grs_y_{j}": f"guidance_y_{j}" for j in (1, 2)},
    **{
        f"{read_out}_{j}": f"guidance_{angle}_{j}"
        for j in (1, 2)
        for read_out, angle in (("grs_theta", "theta"), ("o_eta", "eta"), ("o_phi", "phi"))
    },
}
#: The channels a calibration needs: of LISA Pathfinder, and of one LISA spacecraft.
REQUIRED = ("o_1", "o_12", "f_x_1", "f_x_2")
LISA_REQUIRED = ("o_1", "o_2", "grs_y_1", "grs_y_2", "F_y_1", "F_y_2", "dws_phi_1", "dws_phi_2")


def has_lisa_channels(channels: Container[str]) -> bool:
    """Return whether channels are those of a LISA spacecraft: each test mass has an interferometer."""
    return "o_2" in channels and "o_12" not in channels


def required(channels: Container[str]) -> tuple[str, ...]:
    """Return the channels that a calibration needs of telemetry that has these."""
    return LISA_REQUIRED if has_lisa_channels(channels) else REQUIRED


def utc(t0: str) -> datetime:
    """Return a start time that compares with others; without an offset it is UTC, as the contract says."""
    moment = datetime.fromisoformat(t0)
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def whole(value: object) -> object:
    """Let a whole number pass that was stored as a float."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _iso_8601(t0: Any) -> object:
    with suppress(TypeError, ValueError, OverflowError):
        if "T" in t0 or " " in t0:  # a date has no time
            utc(t0)
            return t0
    raise problem(f"{shown(t0)}, expected date and time in UTC, ISO 8601, such as '2016-04-16T14:00:00Z'")


def _printable(name: str) -> str:
    if not name.isprintable():
        raise problem(f"{shown(name)} has letters that cannot be printed, expected a name without them")
    return name


def _period(value: object) -> object:
    number = whole(value)
    is_number = isinstance(number, int) and not isinstance(number, bool) and number >= 0
    if not (is_number or (isinstance(value, str) and value.strip())):
        raise problem(f"{shown(value)}, expected a whole number, zero or more, or a word")
    return value


class _Unit(str):
    """Unit of a root attribute."""


#: Where the telemetry has +x point to; the first is the one meant where a file says nothing.
XAxis = Literal["towards test mass 2", "towards test mass 1"]
TOWARDS_2: XAxis = "towards test mass 2"
TOWARDS_1: XAxis = "towards test mass 1"

_Name = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]
_Force = Annotated[float, Field(ge=0, le=1e3), _Unit("N")]
_Torque = Annotated[float, Field(ge=0, le=1e3), _Unit("N m")]
_Length = Annotated[float, Field(ge=-10, le=10), _Unit("m")]


class Root(BaseModel, strict=True, allow_inf_nan=False, extra="allow"):
    """The root attributes that every file has; the fields have the names of `Telemetry`."""

    run: _Name
    experiment: _Name
    kind: Literal["sysid", "noise"]
    fs: Annotated[float, Field(ge=0.25, le=10), _Unit("Hz")]
    t0: Annotated[str, BeforeValidator(_iso_8601)]
    F_max_1: _Force
    F_max_2: _Force
    N_max_1: _Torque
    N_max_2: _Torque
    alignment_epoch: Annotated[int, Field(ge=0), BeforeValidator(whole)]
    m_tm: Annotated[float, Field(ge=1e-3, le=1e6), _Unit("kg")]


class _Optional(BaseModel, strict=True, allow_inf_nan=False):
    """Root attributes that a file may have; the last three are those of LISA."""

    x_axis: XAxis = TOWARDS_2
    inertial_period: Annotated[object, BeforeValidator(_period)] = 0
    half_opening: Annotated[float, Field(ge=0, le=math.pi / 2), _Unit("rad")] = 0.0
    d_x: _Length = 0.0
    d_y: _Length = 0.0


#: Every root attribute that describes a run, with its unit, None for what is no quantity.
ATTRIBUTES: Mapping[str, str | None] = {
    name: next((str(unit) for unit in field.metadata if isinstance(unit, _Unit)), None)
    for name, field in (Root.model_fields | _Optional.model_fields).items()
} | {"I_yy": "kg m2", "I_zz": "kg m2", "omega2_phi": "s-2", "omega2_eta": "s-2"}


def check_root(place: str, attributes: Mapping[str, object]) -> Root:
    """Return root attributes, which are at `place`, as `Telemetry` has them.

    Raises
    ------
    InputError
        If one is missing or breaks the contract.
    """
    try:
        _Optional.model_validate(attributes)
        return Root.model_validate(attributes)
    except ValidationError as error:
        raise InputError(f"{place}: attribute {validation_messages(error, written=False)}") from error
