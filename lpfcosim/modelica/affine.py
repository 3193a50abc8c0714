"""Linear forms: of equations to be solved, and of derivatives, so that a step can be exact."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from lpfcosim.modelica.evaluator import TIME
from lpfcosim.modelica.event_functions import switches
from lpfcosim.modelica.sorted_model import Affine, Assignment


def linear(
    expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol], moving: set[sp.Symbol]
) -> tuple[sp.Matrix, sp.Matrix] | None:
    """Return M and r of ``expressions = M symbols + r``; None if M, or an ``if``, depends on what moves."""
    matrix = sp.Matrix(expressions).jacobian(symbols) if symbols else sp.zeros(len(expressions), 0)
    # The derivative of an `if` says nothing of its condition.
    if matrix.free_symbols & moving or switches(expressions, moving):
        return None
    return matrix, sp.Matrix(expressions).xreplace(dict.fromkeys(symbols, sp.S.Zero))


def affine(
    derivatives: Sequence[Assignment], held: Sequence[sp.Symbol], delayed: Sequence[sp.Symbol]
) -> Affine | None:
    """Return the matrices of the derivatives if these are affine in states, held and delayed quantities."""
    states, rates = [x for x, _ in derivatives], [e for _, e in derivatives]
    used = [w for w in held if any(e.has(w) for e in rates)]
    varying = [*states, *used, *delayed]
    form = linear(rates, varying, {*varying, TIME}) if rates else None
    if form is None or TIME in form[1].free_symbols:
        return None
    matrix, constant = form
    n = len(states)
    return Affine(matrix[:, :n], matrix[:, n:].row_join(constant), tuple(used))
