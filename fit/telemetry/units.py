"""Quantities with units, as archives and maps of them state them, turned into SI."""

import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(?=[^\d\s.])(.*\S)\s*")
_BARE_POWER = re.compile(r"(?<=[^\W\d_])(?=[+-]?\d)")  # the 2 of m/s2, the -2 of m s-2
_POWER_OF_A_NUMBER = re.compile(r"\d\s*(\^|\*\*)")  # no unit needs 9^9^9^9, and none may take for ever


@cache
def _registry() -> "pint.UnitRegistry[float]":
    import pint  # takes its time

    return pint.UnitRegistry()


def factor(unit: str, si: str) -> float:
    """Return what a value in `unit` is multiplied by to be in `si`, a unit of the contract.

    Raises
    ------
    ValueError
        If `unit` is not known or measures something else.

    Examples
    --------
    >>> factor("nm", "m"), factor("pm/s2", "m s-2"), factor("m s-2", "m s-2")
    (1e-09, 1e-12, 1.0)
    """
    try:
        (given, kind), (wanted, wanted_kind) = _root(unit), _root(si)
    except Exception as error:  # pint raises whatever its tokeniser, its parser or its arithmetic raise
        raise ValueError(f"unit {unit!r} is not known") from error
    # Root units, not dimensions: to pint a radian has none, but 1 rad/s is not 1 Hz.
    if kind != wanted_kind:
        raise ValueError(f"unit {unit!r} does not measure what {si or '1'!r} does")
    return float(f"{given / wanted:.15g}")


def same_unit(a: str, b: str) -> bool:
    """Tell whether two texts spell one unit; prefixes are not converted.

    Examples
    --------
    >>> same_unit("m s-2", "m/s^2"), same_unit("nm", "m")
    (True, False)
    """
    try:
        return a == b or factor(a, b) == 1  # pint, which takes its time, is seldom asked
    except ValueError:
        return False


def to_si(value: str | float, si: str) -> float:
    """Return a quantity such as ``"2200 pN"``, or a number that is in `si` already, in `si`.

    Raises
    ------
    ValueError
        If it is no such quantity.

    Examples
    --------
    >>> to_si("10.4 pN m", "N m"), to_si(1.04e-11, "N m")
    (1.04e-11, 1.04e-11)
    """
    if not isinstance(value, str):
        return float(value)
    match = _NUMBER_AND_UNIT.fullmatch(value)
    if match is None:
        raise ValueError("no number with a unit")
    # decimal arithmetic, so that "10.4 pN m" is the float 1.04e-11 and not its neighbour
    return float(Decimal(match[1]) * Decimal(repr(factor(match[2], si))))


def _root(unit: str) -> tuple[float, object]:
    """Return a unit as a number of root units, and these."""
    if len(unit) > 80 or _POWER_OF_A_NUMBER.search(unit):
        raise ValueError(unit)
    text = _BARE_POWER.sub("^", unit.replace("·", " ")).strip()
    registry = _registry()
    root = registry.Quantity(1.0, registry.parse_units(text)).to_root_units()
    return float(root.magnitude), root.units
