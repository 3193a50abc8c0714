"""A model in the order in which it is computed: what the translator hands to the printer of C."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import sympy as sp

from lpfcosim.modelica.flat_model import Variable
from lpfcosim.modelica.sources import Node

Assignment = tuple[sp.Symbol, sp.Expr]


def resolved(assignments: Iterable[Assignment]) -> dict[sp.Symbol, sp.Expr]:
    """Return what is assigned to each symbol, in terms of symbols that are not assigned."""
    values: dict[sp.Symbol, sp.Expr] = {}
    for symbol, value in assignments:
        values[symbol] = value.xreplace(values)
    return values


@dataclass(frozen=True)
class Scalar:
    """One scalar element of a variable as the FMU shows it.

    ``kind`` is ``parameter``, ``calculated`` (a parameter that follows from others), ``input``, ``state``,
    ``discrete``, ``algebraic`` or ``rate`` (the derivative of a state); ``value`` is the start value, or what
    a calculated parameter equals.
    """

    symbol: sp.Symbol
    kind: str
    value: sp.Expr
    nominal: float | None
    minimum: float | None
    maximum: float | None
    variable: Variable


@dataclass(frozen=True)
class Event:
    """``target = value`` whenever ``clock`` ticks."""

    target: sp.Symbol
    value: sp.Expr
    clock: int
    span: Node


@dataclass(frozen=True)
class Affine:
    """``der(x) = A x + B [held; delayed; 1] + q``.

    The affine part is integrated exactly. The remainder q is held over a step at its value in the middle,
    extrapolated as 1.5 q_n - 0.5 q_(n-1) from the values at the begins of this step and of the last one (an
    exponential Adams-Bashforth method); in the first step it is q_0. Its error is of relative order
    (h omega)^2, where omega is the rate at which q changes.

    Attributes
    ----------
    a, b : Matrix
        Depend on parameters only.
    held : tuple of symbol
        Inputs and sampled variables that the columns of ``b`` begin with.
    remainder : tuple of expression
        q by state: terms of degree 2 and higher in states, held, delayed and algebraic variables.
    algebraic : tuple of (symbol, expression)
        Assignments that the remainder needs, in an order in which they can be executed.
    """

    a: sp.Matrix
    b: sp.Matrix
    held: tuple[sp.Symbol, ...]
    remainder: tuple[sp.Expr, ...]
    algebraic: tuple[Assignment, ...]


@dataclass(frozen=True)
class Delay:
    """``delay(value, duration)`` met in an equation; it stands in the algebra as ``symbol``."""

    symbol: sp.Symbol
    value: sp.Expr
    duration: sp.Expr
    span: Node | None


@dataclass(frozen=True)
class Assertion:
    """``condition`` holds at every communication point, or ``message`` is an error."""

    condition: sp.Basic
    message: str


@dataclass(frozen=True)
class SortedModel:
    """A model ready to be printed.

    Attributes
    ----------
    scalars : tuple of Scalar
        In the order of their value references.
    calculated, algebraic : tuple of (symbol, expression)
        Assignments, in an order in which they can be executed.
    solved : tuple of (symbol, expression)
        The same once more as the equations gave it, with the derivatives ``der(x)`` among them: each in terms
        of those before it.
    derivatives : tuple of (state, expression)
        Expressions hold states, inputs, sampled variables, delayed signals, parameters and time only.
    affine : Affine or None
        The derivatives as matrices and a polynomial remainder; None if they have no such form.
    delays : tuple of Delay
        Delayed held signals.
    clocks : tuple of (start, period)
        One for each ``when sample``.
    events : tuple of Event
        In an order in which they can be executed.
    assertions : tuple of Assertion
        Conditions on any variables.
    """

    name: str
    description: str
    scalars: tuple[Scalar, ...]
    calculated: tuple[Assignment, ...]
    algebraic: tuple[Assignment, ...]
    solved: tuple[Assignment, ...]
    derivatives: tuple[Assignment, ...]
    affine: Affine | None
    delays: tuple[Delay, ...]
    clocks: tuple[tuple[sp.Expr, sp.Expr], ...]
    events: tuple[Event, ...]
    assertions: tuple[Assertion, ...]
