"""Values and units of the variables of FMUs."""

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from fit import units
from fit.errors import quote
from lpfcosim.errors import InputError
from lpfcosim.messages import line

Value = bool | int | float | str

REALS = ("Real", "Float64", "Float32")
_INTEGERS = {"Integer": (-(2**31), 2**31 - 1), "Enumeration": (-(2**31), 2**31 - 1)} | {
    f"{sign}Int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
_BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def converted(variable: Any, value: Value, place: str) -> Value:
    """Return a value as the type of a variable has it; InputError if it is another type or out of range."""
    kind, is_number = variable.type, isinstance(value, int | float) and not isinstance(value, bool)
    if kind in REALS:
        fits, expected = is_number and math.isfinite(float(value)), "a finite number"
    elif kind in _INTEGERS:
        low, high = _INTEGERS[kind]
        fits = is_number and isinstance(value, int) and low <= value <= high
        expected = f"an integer from {low} to {high}"
    elif kind == "Boolean":
        fits, expected = isinstance(value, bool), "true or false"
    else:
        fits, expected = kind == "String" and isinstance(value, str), "a string"
    for name, words, sign in (("min", "at least", 1), ("max", "at most", -1)) if fits else ():
        limit: Any = getattr(variable, name) or getattr(variable.declaredType, name, None)
        with suppress(TypeError, ValueError):  # there is none, or only in an archive that is not valid
            if sign * (float(value) - float(limit)) < 0:
                fits, expected = False, f"{words} {line(limit)}"
    if not fits:
        raise InputError(f"{place}: {quote(value)}, expected {expected} (type {kind})")
    return float(value) if kind in REALS else value


def base_unit(unit: Any) -> dict[str, str]:
    """Return the attributes of FMPy's record of a base unit that are not at their defaults."""
    attributes = {name: str(getattr(unit, name)) for name in _BASE_UNITS if getattr(unit, name)}
    defaults = {"factor": 1.0, "offset": 0.0}
    return attributes | {n: repr(getattr(unit, n)) for n, v in defaults.items() if getattr(unit, n) != v}


def other_unit(base: Mapping[str, str], expected: str) -> str:
    """Return what a unit means by its base units, if that is not the unit expected; else nothing."""
    exponents = {n: int(p) for n, p in base.items() if n in _BASE_UNITS}
    factor, offset = float(base.get("factor", 1)), float(base.get("offset", 0))
    exponents_expected, _, _ = units.in_base_units(expected)
    if exponents == exponents_expected and abs(factor - 1) <= 1e-12 and not offset:
        return ""
    product = ".".join(f"{base}{power if power != 1 else ''}" for base, power in exponents.items()) or "1"
    meaning = expected if exponents == exponents_expected else product
    meaning = meaning if factor == 1 else f"{factor:g} {meaning}"
    return f"{meaning} with an offset of {offset:g}" if offset else meaning
