"""Quantities with units, as campaigns, archives and maps state them, in SI; values with sigmas."""

import math
import re
from decimal import Decimal
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_NUMBER_AND_UNIT = re.compile(rf"\s*({_NUMBER})(?:\s*(?=[^\d\s.])|\s+(?=1\s*/))(.*\S)\s*")
_BARE_POWER = re.compile(r"(?<=[^\W\d_])(?=[+-]?\d)")  # the 2 of m/s2, the -2 of m s-2
_PRODUCT = re.compile(r"·|\.(?=[^\W\d_])")  # as in N·m and N.m
# No unit needs 9^9^9^9 or (9 m)^9999, and none may take for ever.
_ENDLESS = re.compile(r"\d\s*(?:\^|\*\*)|\d{4}|(?:\)\s*(?:\^|\*\*).*){2}")
_LONGEST = 80  # letters
_SPELLING = re.compile(r"[\w°·⁺⁻%^*/.(){}+\-\s]*")  # pint ignores any other sign


class UnknownUnitError(ValueError):
    """There is no such unit."""


@cache
def registry() -> "pint.UnitRegistry[float]":
    """Return the units there are."""
    import pint  # slow to import

    return pint.UnitRegistry()


def factor(unit: str, si: str) -> float:
    """Return what a value in `unit` is multiplied by to be in `si`, a unit of the contract.

    Raises
    ------
    ValueError
        If `unit` is not known (`UnknownUnitError`) or measures something else.

    Examples
    --------
    >>> factor("nm", "m"), factor("pm/s2", "m s-2"), factor("m s-2", "m s-2")
    (1e-09, 1e-12, 1.0)
    """
    (kind, size, offset), (si_kind, si_size, _) = in_base_units(unit), in_base_units(si)
    # Base units, not dimensions: to pint a radian has none, but 1 rad/s is not 1 Hz.
    if kind != si_kind or offset:
        raise ValueError(f"unit {unit!r} does not measure what {si or '1'!r} does")
    return float(f"{size / si_size:.15g}")


@cache
def in_base_units(unit: str) -> tuple[dict[str, float], float, float]:
    """Return the base units that `unit` is made of, by symbol, with their powers, its factor and its offset.

    Raises
    ------
    ValueError
        If it is not known.

    Examples
    --------
    >>> in_base_units("km/s"), in_base_units("kg.m/s2")
    (({'m': 1, 's': -1}, 1000.0, 0.0), ({'kg': 1, 'm': 1, 's': -2}, 1.0, 0.0))
    """
    try:
        zero, one = (registry().Quantity(x, _pint_spelling(unit)).to_base_units() for x in (0.0, 1.0))
    except Exception as error:  # pint raises whatever its tokeniser, its parser or its arithmetic raise
        raise UnknownUnitError(f"unit {unit!r} is not known") from error
    exponents = {registry().get_symbol(name): float(str(power)) for name, power in one.unit_items()}
    powers = {symbol: int(power) if power.is_integer() else power for symbol, power in exponents.items()}
    return powers, one.magnitude - zero.magnitude, zero.magnitude


def same_unit(a: str, b: str) -> bool:
    """Return whether two texts spell one unit; prefixes are not converted.

    Examples
    --------
    >>> same_unit("m s-2", "m/s^2"), same_unit("nm", "m")
    (True, False)
    """
    try:
        return a == b or factor(a, b) == 1
    except ValueError:
        return False


def contract_spelling(unit: str) -> str:
    """Spell a unit as the telemetry contract does, without a slash.

    Examples
    --------
    >>> contract_spelling("kg.m/s2"), contract_spelling("1/s2"), contract_spelling("1")
    ('kg m s-2', 's-2', '')
    """
    numerator, _, denominator = unit.partition("/")
    factors = [factor for factor in numerator.split(".") if factor != "1"]
    for factor in filter(None, denominator.strip("()").split(".")):
        name = factor.rstrip("0123456789")
        factors.append(f"{name}-{factor.removeprefix(name) or 1}")
    return " ".join(factors)


def split(text: str) -> tuple[str, str] | None:
    """Return the number and the unit that a text consists of, None if it does not."""
    match = _NUMBER_AND_UNIT.fullmatch(text) if len(text) <= _LONGEST else None
    return (match[1], match[2]) if match else None


def to_si(value: str | float, si: str) -> float:
    """Return a quantity such as ``"2200 pN"``, or a number that is in `si` already, in `si`.

    Raises
    ------
    ValueError
        If it is no such quantity (`UnknownUnitError` if its unit is none).

    Examples
    --------
    >>> to_si("10.4 pN m", "N m"), to_si(1.04e-11, "N m")
    (1.04e-11, 1.04e-11)
    """
    if not isinstance(value, str):
        try:
            return float(value)
        except OverflowError as error:
            raise ValueError("larger than any float") from error
    number_and_unit = split(value)
    if number_and_unit is None:
        raise ValueError("no number with a unit")
    # decimal arithmetic, so that "10.4 pN m" is the float 1.04e-11 and not its neighbour
    return float(Decimal(number_and_unit[0]) * Decimal(repr(factor(number_and_unit[1], si))))


def _pint_spelling(unit: str) -> str:
    """Return a unit as pint reads it, such as ``kg m/s^2`` for ``kg.m/s2``."""
    if len(unit) > _LONGEST or _ENDLESS.search(unit) or not _SPELLING.fullmatch(unit):
        raise UnknownUnitError(f"unit {unit!r} is not known")
    text = _BARE_POWER.sub("^", _PRODUCT.sub(" ", unit)).strip()
    return f"1{text}" if text.startswith("/") else text


def concise_value(value: float, sigma: float) -> str:
    """Return a value with its sigma in units of the last digits, ``-3.983(52)e-07``."""
    from uncertainties import ufloat  # takes its time

    if not (math.isfinite(value) and 0 < sigma < math.inf):
        return f"{value:.6g}"
    return f"{ufloat(value, sigma):.{significant_digits(sigma)}uS}"


def significant_digits(sigma: float) -> int:
    """Return how many digits of an uncertainty are shown: two, one where it was given with one."""
    return 1 if math.isclose(float(f"{sigma:.0e}"), sigma, rel_tol=1e-9) else 2


def prior_text(mean: float, sigma: float, unit: str = "") -> str:
    """Return mean and sigma of a prior as they were stated, not rounded: ``1.07634 ± 0.02``."""
    return f"{mean:.9g} ± {sigma:.3g} {campaign_unit(unit)}".rstrip()


def campaign_unit(unit: str) -> str:
    """Return a unit as a campaign takes it: ``kg^-1 m^-1`` for ``kg-1 m-1``, nothing for ``1``."""
    return "" if unit == "1" else re.sub(r"(?<=[A-Za-z])(-?\d)", r"^\1", unit)
