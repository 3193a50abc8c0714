"""Constraints of parameters of a fit, from options to the table ``[fit.parameters]``."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fit.errors import InputError, quote


@dataclass(frozen=True)
class Constraints:
    """Options about parameters.

    Attributes
    ----------
    fix, tie, prior, bound : sequence of str
        ``NAME`` or ``NAME=VALUE``, ``NAME=EXPR``, ``NAME=MEAN,SIGMA``, ``NAME=MIN:MAX``.
    """

    fix: Sequence[str] = ()
    tie: Sequence[str] = ()
    prior: Sequence[str] = ()
    bound: Sequence[str] = ()

    def tables(self) -> dict[str, dict[str, object]]:
        """Return the constraints by parameter, as ``[fit.parameters]`` has them.

        Raises
        ------
        InputError
            If an option cannot be read, or options contradict each other.
        """
        tables: dict[str, dict[str, object]] = {}
        for option, form, argument in self._arguments():
            name, equals, text = argument.partition("=")
            place = f"{option} {quote(argument)}"
            if not name.strip() or not (equals or option == "--fix"):
                raise InputError(f"{place}: expected {form}")
            entries = _PARSERS[option](text, place, form) if equals else {"vary": False}
            table = tables.setdefault(name.strip(), {})
            if repeated := table.keys() & entries.keys():
                raise InputError(f"{place}: a second {min(repeated)} of {name.strip()}")
            table |= entries
        return tables

    def _arguments(self) -> Iterator[tuple[str, str, str]]:
        for option, form, arguments in (
            ("--fix", "NAME or NAME=VALUE", self.fix),
            ("--tie", "NAME=EXPR", self.tie),
            ("--prior", "NAME=MEAN,SIGMA", self.prior),
            ("--bound", "NAME=MIN:MAX, one of the two may be empty", self.bound),
        ):
            yield from ((option, form, argument) for argument in arguments)


def _parse_number(text: str, place: str, form: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{place}: {quote(text)} is not a number, expected {form}")
    return value


def _parse_value(text: str, place: str, form: str) -> dict[str, object]:
    return {"vary": False, "value": _parse_number(text, place, form)}


def _parse_expression(text: str, place: str, form: str) -> dict[str, object]:
    if not text.strip():
        raise InputError(f"{place}: no expression, expected {form}")
    return {"expr": text.strip()}


def _parse_prior(text: str, place: str, form: str) -> dict[str, object]:
    numbers = text.split(",")
    if len(numbers) != 2:
        raise InputError(f"{place}: expected {form}")
    return {"prior": [_parse_number(number, place, form) for number in numbers]}


def _parse_bounds(text: str, place: str, form: str) -> dict[str, object]:
    numbers = text.split(":")
    if len(numbers) != 2 or not any(number.strip() for number in numbers):
        raise InputError(f"{place}: expected {form}")
    pairs = zip(("min", "max"), numbers, strict=True)
    return {name: _parse_number(number, place, form) for name, number in pairs if number.strip()}


_PARSERS = {
    "--fix": _parse_value,
    "--tie": _parse_expression,
    "--prior": _parse_prior,
    "--bound": _parse_bounds,
}
