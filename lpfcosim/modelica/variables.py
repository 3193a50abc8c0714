"""The variables that an archive declares: in FMI 3.0 an array is one of them, in FMI 2.0 all are scalars."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

import sympy as sp

from lpfcosim.modelica.codegen import Layout, settable_until
from lpfcosim.modelica.system import Scalar


@dataclass(frozen=True)
class Declared:
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
    def settable(self) -> int:
        """When all elements can be set, see `settable_until`."""
        return min(settable_until(s) for s in self.elements)

    @property
    def start(self) -> str:
        """The start values, as the descriptions have them."""
        return " ".join(repr(float(s.value)) for s in self.elements)


def declare(where: Layout, fmi: str) -> tuple[Declared, ...]:
    """Return the variables of a model by value reference, and arrays, where there are any, at their places.

    A scalar has the reference of its place. So has every element of an array; the array itself, if it has
    more than one, gets one after those of all scalars.
    """
    if fmi == "2.0":
        return tuple(
            Declared(s.symbol.name, (s,), (), reference) for reference, s in enumerate(where.order, start=1)
        )
    found: list[Declared] = []
    beyond = 1 + len(where.order)
    for _, together in groupby(where.order, key=lambda s: (s.kind, s.variable.name)):
        elements = tuple(together)
        first = elements[0]
        reference = where.reference[first.symbol]
        if len(elements) > 1:
            reference, beyond = beyond, beyond + 1
        found.append(Declared(first.variable.name, elements, first.variable.dims, reference))
    return tuple(found)


def arrays(declared: Iterable[Declared], where: Layout) -> list[tuple[int, int]]:
    """Return the place of the first element and how many there are, by array, in the order of references."""
    return [(where.reference[d.elements[0].symbol], len(d.elements)) for d in declared if len(d.elements) > 1]


def references(declared: Iterable[Declared]) -> dict[sp.Symbol, int]:
    """Return the value reference of the variable that an element belongs to."""
    return {s.symbol: d.reference for d in declared for s in d.elements}
