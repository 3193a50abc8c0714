"""What makes an expression jump or bend: relations, and the event-generating functions of Modelica."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import sympy as sp


def either(condition: Any, value: sp.Expr, otherwise: sp.Expr) -> sp.Expr:
    """Return ``if condition then value else otherwise``, as it stands."""
    return sp.Piecewise((value, condition), (otherwise, True), evaluate=False)


# Opaque: C functions of the same name in the runtime; a NaN comes out of them as NaN.
EVENT_FUNCTIONS = {
    name: sp.Function(f"modelica_{name}", real=True)
    for name in ("abs", "sign", "min", "max", "floor", "ceil", "limit")
}
# Their derivatives by argument; the others are level between their jumps.
_SLOPES: dict[str, Callable[..., Any]] = {
    "modelica_abs": lambda _, x: EVENT_FUNCTIONS["sign"](x),
    "modelica_min": lambda i, x, y: either(x < y, sp.Integer(i == 1), sp.Integer(i == 2)),
    "modelica_max": lambda i, x, y: either(x > y, sp.Integer(i == 1), sp.Integer(i == 2)),
    "modelica_limit": lambda i, _x, _size: sp.Integer(i == 1),  # as long as nothing is limited
}


def _slope(call: Any, argument: int = 1) -> Any:
    slope = _SLOPES.get(call.func.__name__)
    return slope(argument, *call.args) if slope else sp.S.Zero


for _function in EVENT_FUNCTIONS.values():
    _function.fdiff = _slope


def switches(expressions: Iterable[sp.Expr], symbols: set[sp.Symbol]) -> set[sp.Expr]:
    """Return the relations and event functions that depend on any of the symbols."""
    kinds = (sp.core.relational.Relational, *EVENT_FUNCTIONS.values())
    return {a for e in expressions for a in e.atoms(*kinds) if a.free_symbols & symbols}
