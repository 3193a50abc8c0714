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


_MASSES = (1, 2)
_AXES = ("x", "y", "z")
_ANGLES = ("theta", "eta", "phi")

CHANNELS: Mapping[str, Channel] = {
    "o_1": Channel("m", "interferometer read-out of x_1, test mass 1 relative to the spacecraft"),
    "o_12": Channel("m", "interferometer read-out of x_2 - x_1"),
    "o_2": Channel("m", "LISA: interferometer read-out of x_2, test mass 2 relative to the spacecraft"),
    **{
        f"dws_phi_{j}": Channel("rad", f"LISA: long-range wavefront sensing of phi by assembly {j}")
        for j in _MASSES
    },
    **{
        f"f_x_{j}": Channel("m s-2", f"commanded force on test mass {j} along x per unit mass")
        for j in _MASSES
    },
    "guidance_o_1": Channel("m", "guidance injected into the drag-free loop"),
    "guidance_o_12": Channel("m", "guidance injected into the suspension loop"),
    **{f"F_{k}_sc": Channel("N", f"commanded thrust on the spacecraft along {k}") for k in _AXES},
    **{f"N_{k}_sc": Channel("N m", f"commanded torque on the spacecraft about {k}") for k in _AXES},
    **{
        f"o_{k}_{j}": Channel("rad", f"wavefront-sensing read-out of {k}, test mass {test_mass}")
        for k in ("phi", "eta")
        for j, test_mass in ((1, "1"), (12, "2 less test mass 1"))
    },
    **{
        f"grs_{k}_{j}": Channel(unit, f"capacitive read-out of {k}, test mass {j}")
        for j in _MASSES
        for unit, names in (("m", _AXES), ("rad", _ANGLES))
        for k in names
    },
    **{
        f"F_{k}_{j}": Channel("N", f"commanded force on test mass {j} along {k}")
        for j in _MASSES
        for k in _AXES
    },
    **{
        f"N_{k}_{j}": Channel("N m", f"commanded torque on test mass {j}, angle {k}")
        for j in _MASSES
        for k in _ANGLES
    },
    **{f"ast_{k}": Channel("rad", f"star-tracker attitude against J2000, angle {k}") for k in _ANGLES},
    **{
        f"ast_q_{i}": Channel("", f"star-tracker quaternion J2000 to body, component {i}, scalar last")
        for i in (1, 2, 3, 4)
    },
}
#: The channel that holds the set points of a read-out, by the read-out.
GUIDANCE: Mapping[str, str] = {
    **{name: f"guidance_{name}" for name in ("o_1", "o_2", "o_12")},
    **{f"grs_y_{j}": f"guidance_y_{j}" for j in _MASSES},
    **{
        f"{read_out}_{j}": f"guidance_{angle}_{j}"
        for j in _MASSES
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


def expected_unit(channel: str) -> str | None:
    """Return the unit a file must state for a channel, None for a pure number or a channel not known."""
    return CHANNELS[channel].unit or None if channel in CHANNELS else None


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


class _Unit(str):
    """Unit of a root attribute."""


#: Where the telemetry has +x point to; the first is the one meant where a file says nothing.
XAxis = Literal["towards test mass 2", "towards test mass 1"]
TOWARDS_2: XAxis = "towards test mass 2"
TOWARDS_1: XAxis = "towards test mass 1"

_Name = Annotated[str, Field(min_length=1, max_length=100), AfterValidator(_printable)]
_Force = Annotated[float, Field(ge=0, le=1e3), _Unit("N")]
_Torque = Annotated[float, Field(ge=0, le=1e3), _Unit("N m")]


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


class _Frame(BaseModel, strict=True):
    """The root attribute of the frame, where there is one."""

    x_axis: XAxis = TOWARDS_2


#: Every root attribute that describes a run, with its unit, None for what is no quantity.
ATTRIBUTES: Mapping[str, str | None] = {
    **{
        name: next((str(unit) for unit in field.metadata if isinstance(unit, _Unit)), None)
        for name, field in Root.model_fields.items()
    },
    "x_axis": None,
    "inertial_period": None,
    "I_yy": "kg m2",
    "I_zz": "kg m2",
    "omega2_phi": "s-2",
    "omega2_eta": "s-2",
    "half_opening": "rad",  # this and the following of LISA, see `fit.spacecraft.lisa`
    "d_x": "m",
    "d_y": "m",
}


#: Least and largest values of optional attributes, and how these are written.
RANGES: Mapping[str, tuple[float, float, str]] = {
    "half_opening": (0.0, math.pi / 2, "0 to pi/2"),
    "d_x": (-10.0, 10.0, "-10 to 10"),
    "d_y": (-10.0, 10.0, "-10 to 10"),
}


def check_root(place: str, attributes: Mapping[str, object]) -> Root:
    """Return root attributes, which are at `place`, as `Telemetry` has them.

    Raises
    ------
    InputError
        If one is missing or breaks the contract.
    """
    for name, (low, high, expected) in RANGES.items():
        value = attributes.get(name, low)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            unit = ATTRIBUTES[name]
            raise InputError(f"{place}: attribute {name} = {shown(value)} {unit}: expected {expected} {unit}")
    try:
        _Frame.model_validate(attributes)
        return Root.model_validate(attributes)
    except ValidationError as error:
        raise InputError(f"{place}: attribute {validation_messages(error, written=False)}") from error
