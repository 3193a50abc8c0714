"""Variables of an FMU: which one a name means, the values that its type takes, when they can be set."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Collection, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

from fit.errors import quote
from fit.files import closest_match, suggestion
from lpfcosim.errors import InputError
from lpfcosim.messages import line

Value = bool | int | float | str

REALS = ("Real", "Float64", "Float32")
_ELEMENT = re.compile(r"(.+)\[(\d+(?:\s*,\s*\d+)*)\]")
_NUMBER = re.compile(r"[+-]?\d{1,18}")
_LARGEST_FLOAT32 = 3.4028234663852886e38
_RANGES = {"Integer": (-(2**31), 2**31 - 1)} | {
    f"{sign}Int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}
_DEFAULTS = {"Boolean": "false", "String": ""}
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}
_MOST_ELEMENTS = 10_000  # of an array
_MOST_NAMES, _LONGEST = 12, 250  # that a message lists, and their letters


class MissingVariableError(InputError):
    """An FMU has no variable of a name."""


class Stage(Enum):
    """The state of an instance in which FMI lets a variable be set before the first step."""

    CONFIGURATION = "configuration mode"
    INSTANTIATED = "instantiated"
    INITIALIZATION = "initialization mode"


def resolve(archive: Path, variables: Mapping[str, Any], name: str, model: str) -> tuple[Any, int]:
    """Find the variable and the element, counted row by row, that ``x``, ``x[2]`` or ``x[2,1]`` means.

    Raises
    ------
    MissingVariableError
        If there is none.
    InputError
        If `name` means a whole array.
    """
    if name in variables:
        variable = variables[name]
        if size(variable) != 1:
            extents = " by ".join(str(n) for n in variable.shape)
            raise InputError(
                f"{archive}: variable '{name}' is an array of {extents}; expected one of its elements, such "
                f"as '{name}[{','.join('1' * len(variable.shape))}]'"
            )
        return variable, 0
    match = _ELEMENT.fullmatch(name)
    if match and match[1] in variables:
        variable = variables[match[1]]
        indices, shape = [int(i) - 1 for i in match[2].split(",")], variable.shape or ()
        if len(indices) == len(shape) and all(0 <= i < n for i, n in zip(indices, shape, strict=True)):
            place = 0
            for i, n in zip(indices, shape, strict=True):
                place = place * n + i
            return variable, place
    raise MissingVariableError(f"{archive}: variable '{name}' is missing; expected of the {model}")


def known(names: Collection[str], name: str) -> str:
    """Return which name of an FMU was probably meant, and which there are unless that is much to say."""
    hint = closest_match(name, names)
    if len(names) > _MOST_NAMES or len(hint) > _LONGEST:
        hint = suggestion(name, names)
    return line(hint) if len(hint) <= _LONGEST else ""


def size(variable: Any) -> int:
    """Count the elements of a variable."""
    return math.prod(int(extent) for extent in variable.shape or ())


def start_values(archive: Path, variable: Any, texts: Sequence[str]) -> list[Value]:
    """Return the start values that a description states, row by row, as the type of the variable has them.

    Parameters
    ----------
    archive : Path
        The FMU, for messages.
    variable : object
        FMPy's record of the variable.
    texts : sequence of str
        What the description states: nothing, a value of each element, or one of all.

    Raises
    ------
    InputError
        If a value is not one of the type, or there are too many elements, or another number of values.
    """
    place = f"{archive}: variable {quote(variable.name)}"
    count, kind = size(variable), variable.type
    if not 0 <= count <= _MOST_ELEMENTS:
        raise InputError(f"{place} has {count} elements; expected at most {_MOST_ELEMENTS}")
    try:
        values = [_parse(kind, text) for text in texts or (_DEFAULTS.get(kind, "0"),)]
    except ValueError:
        stated = quote(" ".join(texts))
        raise InputError(f"{place} starts at {stated}; expected start values of type {line(kind)}") from None
    if len(values) not in (1, count):
        raise InputError(
            f"{place} has {len(values)} start values and {count} elements; expected one value for each"
        )
    return values if len(values) == count else values * count


def _parse(kind: str, text: str) -> Value:
    """Return the value that a text of a description states; ValueError if it is not one of its type.

    Types that `convert` refuses, such as Binary, do not come here.
    """
    if kind in REALS:
        return float(text)
    if kind == "String":
        return text
    if kind == "Boolean":
        if text not in _BOOLEANS:
            raise ValueError(text)
        return _BOOLEANS[text]
    low, high = _RANGES["Int64" if kind == "Enumeration" else kind]
    if not low <= int(text) <= high:
        raise ValueError(text)
    return int(text)


def resized(variables: Mapping[str, Any], structure: Mapping[str, Value]) -> dict[str, Any]:
    """Return the variables with the shapes that other values of structural parameters give them."""
    if not structure:
        return dict(variables)

    def extent(dimension: Any) -> int:
        if dimension.variable is None:
            return int(dimension.start)
        return int(structure.get(dimension.variable.name, dimension.variable.start))

    resized_variables = {}
    for name, variable in variables.items():
        resized_variables[name] = variable
        if variable.dimensions:
            resized_variables[name] = copy.copy(variable)
            resized_variables[name].shape = tuple(map(extent, variable.dimensions))
    return resized_variables


def stage(variable: Any) -> Stage | None:
    """Return when a variable can be set, as FMPy sets start values; None: not at all."""
    if variable.causality == "structuralParameter":
        return Stage.CONFIGURATION
    if variable.causality == "input":
        return Stage.INSTANTIATED
    if variable.variability == "constant" or variable.causality == "independent":
        return None
    if variable.initial in ("exact", "approx"):
        return Stage.INSTANTIATED
    tunable = variable.variability == "tunable" and variable.causality != "parameter"
    return Stage.INITIALIZATION if tunable else None


def convert(variable: Any, value: Value) -> Value:
    """Return a value as the type of a variable has it, enumerations as numbers.

    Raises
    ------
    InputError
        If it is of another type or out of range; the message begins with what was found.
    """
    kind = variable.type
    if kind in REALS:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _refused(kind, value, "a number")
        if not math.isfinite(value) or (kind == "Float32" and abs(value) > _LARGEST_FLOAT32):
            raise _refused(kind, value, f"a finite number of type {kind}")
        number: int | float = float(value)
    elif kind in _RANGES:
        low, high = _RANGES[kind]
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise _refused(kind, value, f"an integer from {low} to {high}")
        number = value
    elif kind == "Boolean":
        if not isinstance(value, bool):
            raise _refused(kind, value, "true or false")
        return value
    elif kind == "String":
        if not isinstance(value, str) or "\0" in value:
            raise _refused(kind, value, "a string")
        return value
    elif kind == "Enumeration":
        return _item(variable, value)
    else:
        raise _refused(kind, value, "a variable of another type, as this one cannot be set")
    _check_range(variable, number)
    return number


def _refused(kind: str, value: Value, expected: str) -> InputError:
    return InputError(f"{quote(value)}, expected {expected} (type {kind})")


def _item(variable: Any, value: Value) -> int:
    """Return the number of an item of an enumeration, given by name or number."""
    declared = variable.declaredType.items if variable.declaredType else ()
    items = {i.name: int(i.value) for i in declared if _NUMBER.fullmatch(str(i.value))}
    if isinstance(value, str) and value in items:
        return items[value]
    if isinstance(value, int) and not isinstance(value, bool) and (value in items.values() or not items):
        return value
    names = line(", ".join(f"{quote(name)} ({number})" for name, number in items.items()))
    hint = suggestion(value, items) if isinstance(value, str) else ""
    raise InputError(
        f"{quote(value)}{hint or ','} expected one of {names or 'the numbers'} (type Enumeration)"
    )


def _check_range(variable: Any, value: float) -> None:
    """Refuse a number below the least or above the largest value that the description gives."""
    declared = variable.declaredType
    for name, sign in (("min", 1), ("max", -1)):
        text = getattr(variable, name) or (getattr(declared, name) if declared else None)
        try:
            limit = None if text is None else float(text)
        except ValueError:
            continue  # only in an archive that is not valid
        if limit is not None and sign * (float(value) - limit) < 0:
            raise InputError(f"{quote(value)} is beyond the {name} of {line(text)} that the FMU states")
