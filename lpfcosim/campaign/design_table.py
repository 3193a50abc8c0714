"""Table ``[design]`` of a campaign file."""

from math import prod
from typing import Annotated, get_args

from pydantic import Field, Strict, field_validator

from fit.errors import quote
from fit.files import Table, problem
from lpfcosim.campaign.design_spec import Baseline, DesignSpec, Goal, LimitedQuantity, LimitKind, LimitSpec
from lpfcosim.campaign.units import FORCE, LENGTH, Force, Frequency, Quantity, Torque
from lpfcosim.campaign.values import Duration, Number, Swept

_SPEED = Quantity("a speed", "m s^-1", "0.5 nm/s", "positive")
_RATE = Quantity("a force per time", "N s^-1", "10 pN/s", "positive", largest=1)
MANY = 64  # settings that are tried
Positive = Annotated[Number, Field(gt=0)]


class CapTable(Table):
    """[design.limits.QUANTITY]: limits of every run; of forces also as "40 %" of the authority."""

    peak: str | None = None
    rms: str | None = None
    slew: str | None = None


class ChoicesTable(Table):
    """[design.authority]: allowed values of the authority, the same for all experiments."""

    F_max_1: Swept[Force] = []
    F_max_2: Swept[Force] = []
    N_max_1: Swept[Torque] = []
    N_max_2: Swept[Torque] = []


class DesignTable(Table):
    """[design]: objective and limits of `lpfcosim design`."""

    goal: Goal = "geometric mean"
    held: Baseline = "peaks and rms of thrust"
    limits: dict[LimitedQuantity, CapTable] = {}
    sines: Annotated[int, Strict(), Field(ge=1, le=24)] = 6
    spacing: Frequency = 2e-4
    forbidden: list[Annotated[list[Frequency], Field(min_length=2, max_length=2)]] = []
    weights: dict[str, Positive] = {}
    sigmas: dict[str, Positive] = {}
    no_worse: Positive | None = None
    hours: Annotated[Duration, Field(gt=0)] | None = None
    shortest: Annotated[Duration, Field(ge=3600)] = 21600.0
    authority: ChoicesTable = ChoicesTable()

    @field_validator("authority")
    @classmethod
    def _check_combinations(cls, authority: ChoicesTable) -> ChoicesTable:
        combinations = prod(len(values) or 1 for values in vars(authority).values())
        if combinations > MANY:
            raise problem(f"{combinations} settings to try, expected {MANY} at most")
        return authority

    @field_validator("limits")
    @classmethod
    def _in_units(cls, limits: dict[LimitedQuantity, CapTable]) -> dict[LimitedQuantity, CapTable]:
        for quantity, table in limits.items():
            _caps(quantity, table)
        return limits

    @field_validator("forbidden")
    @classmethod
    def _ascending(cls, bands: list[list[float]]) -> list[list[float]]:
        for low, high in bands:
            if low >= high:
                raise problem(f"a band from {low:g} Hz to {high:g} Hz, expected the lower end first")
        return bands

    def record(self) -> DesignSpec:
        """Return the wishes as the design knows them."""
        caps = tuple(cap for quantity, table in self.limits.items() for cap in _caps(quantity, table))
        fields = self.model_dump(exclude={"limits", "forbidden", "authority"})
        authority = {name: tuple(values) for name, values in vars(self.authority).items() if values}
        forbidden = tuple((low, high) for low, high in self.forbidden)
        return DesignSpec(caps=caps, forbidden=forbidden, authority=authority, **fields)


def _caps(quantity: LimitedQuantity, table: CapTable) -> list[LimitSpec]:
    limits = []
    for kind in get_args(LimitKind):
        text = getattr(table, kind)
        if text is None:
            continue
        if text.strip().endswith("%"):
            limits.append(LimitSpec(quantity, kind, _fraction(quantity, kind, text), of_authority=True))
            continue
        is_displacement = quantity.startswith("o_")
        unit = (
            (_SPEED if is_displacement else _RATE)
            if kind == "slew"
            else (LENGTH if is_displacement else FORCE)
        )
        limits.append(LimitSpec(quantity, kind, unit.to_si(text)))
    return limits


def _fraction(quantity: str, kind: str, text: str) -> float:
    """Return a share of the authority."""
    if quantity not in ("F_x_1", "F_x_2") or kind != "peak":
        raise problem(f"{quote(text)}: only peaks of F_x_1 and F_x_2 have an authority to take a share of")
    try:
        share = float(text.strip().removesuffix("%")) / 100
    except ValueError:
        share = -1.0
    if not 0 < share <= 1:
        raise problem(f'{quote(text)} is no share, write it like "40 %"')
    return share
