"""Split derivatives into an affine part, which is integrated exactly, and a polynomial remainder."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import sympy as sp
from sympy.solvers.solveset import NonlinearError

from lpfcosim.modelica.evaluator import TIME
from lpfcosim.modelica.event_functions import switches
from lpfcosim.modelica.sorted_model import Affine, Assignment


def linear(
    expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol], moving: set[sp.Symbol]
) -> tuple[sp.Matrix, sp.Matrix] | None:
    """Return M and r of ``expressions = M symbols + r``; None if M, or an ``if``, depends on what moves."""
    if switches(expressions, moving):
        return None
    if not symbols:
        return sp.zeros(len(expressions), 0), sp.Matrix(expressions)
    if any(e.has(sp.Piecewise) for e in expressions):  # whose branches only a Jacobian differentiates
        matrix = sp.Matrix(expressions).jacobian(symbols)
        rest = sp.Matrix(expressions).xreplace(dict.fromkeys(symbols, sp.S.Zero))
    else:
        try:
            matrix, negative = sp.linear_eq_to_matrix(list(expressions), list(symbols))
        except NonlinearError:
            return None
        rest = -negative
    return None if matrix.free_symbols & moving else (matrix, rest)


def split_derivatives(
    solved: Sequence[Assignment],
    states: Sequence[sp.Symbol],
    rates: Sequence[sp.Symbol],
    held: Sequence[sp.Symbol],
    delayed: Sequence[sp.Symbol],
) -> Affine | None:
    """Return the derivatives as matrices and remainder, see `Affine`.

    Parameters
    ----------
    solved : sequence of (symbol, expression)
        Assignments of all algebraic variables and rates, each in terms of those before it.
    states, rates : sequence of symbol
        In the same order.
    held, delayed : sequence of symbol
        Inputs and sampled variables, and delayed signals.

    Returns
    -------
    Affine or None
        None if the derivatives depend on time, switch, or are no polynomials in states, held and delayed
        signals.
    """
    if not rates:
        return None
    varying = {TIME, *states, *held, *delayed}
    affine_parts: dict[sp.Symbol, sp.Expr] = {}  # of all assignments, in terms of `varying`
    remainders: dict[sp.Symbol, sp.Expr] = {}  # those that are not zero
    constants: dict[sp.Symbol, sp.Expr] = {}  # likewise, of the affine parts
    for symbol, value in _required(solved, rates):
        nonlinear = _nonlinear_terms(value, {*varying, *affine_parts}, constants)
        if nonlinear is None:
            return None
        affine_value = sp.expand(value - nonlinear) if nonlinear else value
        affine_parts[symbol] = affine_value.xreplace(affine_parts)
        constant = affine_parts[symbol].xreplace(dict.fromkeys(varying, sp.S.Zero))
        if constant != 0:
            constants[symbol] = constant
        remainder = nonlinear + sum(affine_value.diff(s) * r for s, r in remainders.items())
        if remainder != 0:
            remainders[symbol] = remainder
    expressions = [affine_parts[rate] for rate in rates]
    used = [w for w in held if any(e.has(w) for e in expressions)]
    form = linear(expressions, [*states, *used, *delayed], varying)
    if form is None or TIME in form[1].free_symbols:
        return None
    matrix, constant = form
    n = len(states)
    remainder_of_rates = tuple(remainders.get(rate, sp.S.Zero) for rate in rates)
    symbols = {s for e in remainder_of_rates for s in e.free_symbols}
    return Affine(
        matrix[:, :n],
        matrix[:, n:].row_join(constant),
        tuple(used),
        remainder_of_rates,
        tuple(_required(solved, symbols)),
    )


def _required(solved: Sequence[Assignment], symbols: Collection[sp.Symbol]) -> list[Assignment]:
    """Return the assignments that ``symbols`` need, in their order."""
    required = set(symbols)
    selection = []
    for symbol, value in reversed(solved):
        if symbol in required:
            required |= value.free_symbols
            selection.append((symbol, value))
    return selection[::-1]


def _nonlinear_terms(
    value: sp.Expr, symbols: set[sp.Symbol], constants: Mapping[sp.Symbol, sp.Expr]
) -> sp.Expr | None:
    """Return the terms of degree 2 and higher in the departures of ``symbols`` from their ``constants``.

    None if ``value`` is no polynomial in them.
    """
    variables = value.free_symbols & symbols
    if not any(value.diff(s).free_symbols & variables for s in variables):
        return sp.S.Zero
    if TIME in variables or switches([value], variables) or not value.is_polynomial(*variables):
        return None
    shifts = {s: constants[s] for s in variables if s in constants}
    terms = sp.Add.make_args(sp.expand(value.xreplace({s: s + c for s, c in shifts.items()})))
    nonlinear = sp.Add(*(term for term in terms if sp.Poly(term, *variables).total_degree() > 1))
    return nonlinear.xreplace({s: s - c for s, c in shifts.items()})
