"""Table ``[design]`` of a campaign file: objective and limits of `lpfcosim design`."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, Strict, field_validator

from fit.errors import quote
from fit.files import Table, problem
from lpfcosim.quantities import FORCE, LENGTH, Frequency, Number, Quantity

_SPEED = Quantity("a speed", "m s^-1", "0.5 nm/s", "positive")
_RATE = Quantity("a force per time", "N s^-1", "10 pN/s", "positive", largest=1)
Baseline = Literal["peaks and rms of thrust", "peaks", "rms"]
LimitedQuantity = Literal["o_1", "o_12", "F_x_1", "F_x_2", "F_x_sc"]
LimitKind = Literal["peak", "rms", "slew"]


@dataclass(frozen=True)
class Cap:
    """A limit as the file has it: SI, or as a fraction of the authority, the direct force included."""

    quantity: LimitedQuantity
    kind: LimitKind
    value: float
    of_authority: bool = False


class CapTable(Table):
    """[design.limits.QUANTITY]: limits of every run; of forces also as "40 %" of the authority."""

    peak: str | None = None
    rms: str | None = None
    slew: str | None = None


class DesignTable(Table):
    """[design]: objective and limits of `lpfcosim design`.

    The logarithm of a sigma counts as much as its weight. No run exceeds what it reaches before (``held``),
    unless `limits` states another limit. A loop gets at most so many ``sines``, apart by ``spacing`` [Hz] or
    more, none in a ``forbidden`` band [Hz].
    """

    held: Baseline = "peaks and rms of thrust"
    limits: dict[LimitedQuantity, CapTable] = {}
    sines: Annotated[int, Strict(), Field(ge=1, le=24)] = 6
    spacing: Frequency = 2e-4
    forbidden: list[Annotated[list[Frequency], Field(min_length=2, max_length=2)]] = []
    weights: dict[str, Annotated[Number, Field(gt=0)]] = {}

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

    @property
    def caps(self) -> tuple[Cap, ...]:
        """The limits of `limits`."""
        return tuple(cap for quantity, table in self.limits.items() for cap in _caps(quantity, table))


def _caps(quantity: LimitedQuantity, table: CapTable) -> list[Cap]:
    is_displacement = quantity.startswith("o_")
    units: dict[LimitKind, Quantity] = dict.fromkeys(("peak", "rms"), LENGTH if is_displacement else FORCE)
    units["slew"] = _SPEED if is_displacement else _RATE
    caps = []
    for kind, unit in units.items():
        text = getattr(table, kind)
        if text is not None and text.strip().endswith("%"):
            caps.append(Cap(quantity, kind, _fraction(quantity, kind, text), of_authority=True))
        elif text is not None:
            caps.append(Cap(quantity, kind, unit.to_si(text)))
    return caps


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
