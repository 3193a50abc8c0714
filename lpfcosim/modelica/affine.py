"""Derivatives that are affine in states and held quantities, so that a step can be exact."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from lpfcosim.modelica.evaluate import TIME
from lpfcosim.modelica.events import switches


@dataclass(frozen=True)
class Affine:
    """``der(x) = A x + B [held; delayed; 1]``; A and B depend on parameters only."""

    a: sp.Matrix
    b: sp.Matrix
    held: tuple[sp.Symbol, ...]


def affine(
    derivatives: tuple[tuple[sp.Symbol, sp.Expr], ...], held: list[sp.Symbol], delayed: list[sp.Symbol]
) -> Affine | None:
    """Return the matrices of the derivatives if these are affine in states, held and delayed quantities."""
    if not derivatives:
        return None
    states = [x for x, _ in derivatives]
    rates = sp.Matrix([e for _, e in derivatives])
    a = rates.jacobian(states)
    used = [w for w in held if any(e.has(w) for e in rates)]
    varying = [*used, *delayed]
    forcing = rates.jacobian(varying) if varying else sp.zeros(len(states), 0)
    constant = rates.xreplace(dict.fromkeys([*states, *varying], sp.S.Zero))
    b = forcing.row_join(constant)
    moving = {*states, *varying, TIME}
    # The derivative of an `if` says nothing of its condition, which must not depend on what varies either.
    if switches(rates, moving):
        return None
    if (a.free_symbols | b.free_symbols) & moving or a.atoms(sp.Derivative, sp.Subs) | b.atoms(
        sp.Derivative, sp.Subs
    ):
        return None
    return Affine(a, b, tuple(used))
