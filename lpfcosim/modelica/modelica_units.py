"""Units as Modelica spells them, and the unit of a derivative."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable

from fit.units import in_base_units

_BASE_UNITS = {"kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol",
               "candela": "cd", "radian": "rad"}  # fmt: skip


@functools.cache
def parse_unit(unit: str) -> tuple[dict[str, int], float, float]:
    """Return the powers of the base units of FMI in a unit, its factor and its offset.

    Raises
    ------
    ValueError, KeyError
        If it is not known.
    """
    powers, factor, offset = in_base_units(_pint_spelling(unit))
    return {_BASE_UNITS[name]: power for name, power in powers.items()}, factor, offset


def per_second(unit: str, known: Iterable[str]) -> str:
    """Return the unit of the derivative of what is in ``unit``: one of those known if it fits.

    Examples
    --------
    >>> per_second("m/s", ["N", "m/s2"])
    'm/s2'
    >>> per_second("N", ["Hz"])
    'N.s-1'
    """
    powers, factor, _ = parse_unit(unit)
    derivative = {**powers, "s": powers.get("s", 0) - 1}
    derivative = {name: power for name, power in derivative.items() if power}
    for candidate in sorted(known):
        # Not Hz, which is for what repeats.
        if re.search(r"s-?\d*\)?$", candidate) and parse_unit(candidate)[:2] == (derivative, factor):
            return candidate
    numerator, slash, denominator = unit.partition("/")
    if slash:
        return f"{numerator}/({denominator.strip('()')}.s)"
    return "s-1" if unit == "1" else f"{unit}.s-1"


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


def _pint_spelling(unit: str) -> str:
    """``kg.m/s2`` as Modelica writes it, ``kg*m/s**2`` as pint reads it."""
    if unit == "1":
        return "dimensionless"
    numerator, slash, denominator = unit.partition("/")
    factors = [
        re.sub(r"(?<=[A-Za-z])(-?\d+)", r"**\1", p).replace(".", "*")
        for p in (numerator, denominator.strip("()"))
    ]
    return f"{factors[0]}/({factors[1]})" if slash else factors[0]
