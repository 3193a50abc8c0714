"""The variables that an archive declares: in FMI 3.0 an array is one of them, in FMI 2.0 all are scalars."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

import sympy as sp

from lpfcosim.modelica.c_printer import Layout, settable_until
from lpfcosim.modelica.sorted_model import Scalar


@dataclass(frozen=True)
class FmiVariable:
    """One variable of a model description.

    Attributes
    ----------
    name : str
        As in Modelica.
    elements : tuple of Scalar
        Row by row; of a scalar the one.
    dims : tuple of int
        Extents; empty for a scalar.
    reference : int
        Value reference of all together.
    """

    name: str
    elements: tuple[Scalar, ...]
    dims: tuple[int, ...]
    reference: int

    @property
    def kind(self) -> str:
        """That of its elements."""
        return self.elements[0].kind

    @property
    def causality(self) -> str:
        """``input``, ``output`` or ``local``."""
        return self.elements[0].variable.causality

    @property
    def unit(self) -> str | None:
        """As declared."""
        return self.elements[0].variable.unit

    @property
    def description(self) -> str:
        """As declared, possibly empty."""
        return self.elements[0].variable.description or ""

    @property
    def settable(self) -> int:
        """When all elements can be set, see `settable_until`."""
        return min(settable_until(s) for s in self.elements)

    @property
    def start(self) -> str:
        """The start values, as the descriptions have them."""
        return " ".join(repr(float(s.value)) for s in self.elements)


def declare_variables(layout: Layout, fmi: str) -> tuple[FmiVariable, ...]:
    """Return the variables of a model by value reference, and arrays, where there are any, at their places.

    A scalar has the reference of its place. So has every element of an array; the array itself, if it has
    more than one, gets one after those of all scalars.
    """
    if fmi == "2.0":
        return tuple(
            FmiVariable(s.symbol.name, (s,), (), reference)
            for reference, s in enumerate(layout.order, start=1)
        )
    variables: list[FmiVariable] = []
    array_reference = 1 + len(layout.order)
    for _, group in groupby(layout.order, key=lambda s: (s.kind, s.variable.name)):
        elements = tuple(group)
        variable = elements[0].variable
        reference = layout.reference[elements[0].symbol]
        if len(elements) > 1:
            reference, array_reference = array_reference, array_reference + 1
        variables.append(FmiVariable(variable.name, elements, variable.dims, reference))
    return tuple(variables)


def array_extents(variables: Iterable[FmiVariable], layout: Layout) -> list[tuple[int, int]]:
    """Return the place of the first element and how many there are, by array, in the order of references."""
    return [
        (layout.reference[d.elements[0].symbol], len(d.elements)) for d in variables if len(d.elements) > 1
    ]


def value_references(variables: Iterable[FmiVariable]) -> dict[sp.Symbol, int]:
    """Return the value reference of the variable that an element belongs to."""
    return {s.symbol: d.reference for d in variables for s in d.elements}
