"""Equations: gathered from the model, put into the order of computation, and solved for one unknown each.

In go the equations as Modelica has them, in any order and not solved for anything. Out comes an assignment
for every unknown, such that each needs those before it only. Equations that need each other (an algebraic
loop) are solved rows_of_block if they are linear in their unknowns, and refused if not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching
from sympy.utilities.iterables import strongly_connected_components

from lpfcosim.modelica.affine import linear
from lpfcosim.modelica.arrays import scalar
from lpfcosim.modelica.evaluator import Evaluator
from lpfcosim.modelica.sorted_model import Assignment
from lpfcosim.modelica.sources import Node


@dataclass(frozen=True)
class Residual:
    """An equation between scalars, ``value = 0``, and its place."""

    value: sp.Expr
    span: Node


def collect(evaluate: Evaluator) -> list[Residual]:
    """Evaluate all equations outside `when`, element by element; those in declarations are among them."""
    residuals: list[Residual] = []
    for equation in evaluate.model.equations:
        indices = {name: scalar(sp.Integer(i)) for name, i in equation.indices.items()}
        for value in np.ravel(evaluate(equation.residual, indices)):
            if any(s.name.startswith("pre(") for s in value.free_symbols):
                evaluate.refuse("pre() outside when", equation.span)
            residuals.append(Residual(value, equation.span))
    for v in evaluate.model.variables:
        # The equation of a declaration (Real y = …) does not stand among the equations.
        if v.binding is not None and v.variability in ("continuous", "discrete") and v.causality != "input":
            values = np.ravel(evaluate.value(v.name)) - np.ravel(evaluate.attribute(v, v.binding))
            residuals += [Residual(value, v.span) for value in values]
    return residuals


def solve(
    evaluate: Evaluator, equations: Sequence[Residual], unknowns: Sequence[sp.Symbol]
) -> list[Assignment]:
    """Return an assignment for every unknown, in an order in which they can be executed.

    Raises
    ------
    UnsupportedError
        Naming the place and the unknowns of equations that do not determine them, or not linearly.
    """
    if not unknowns:
        return []
    column = {u: j for j, u in enumerate(unknowns)}
    columns_of = [sorted(column[s] for s in e.value.free_symbols if s in column) for e in equations]
    entries = [(i, j) for i, row in enumerate(columns_of) for j in row]
    rows, columns = np.array(entries, dtype=np.int32).reshape(-1, 2).T
    shape = len(equations), len(unknowns)
    incidence = csr_array((np.ones(len(entries), dtype=np.int8), (rows, columns)), shape=shape)
    matching = [
        int(j) for j in maximum_bipartite_matching(incidence, perm_type="column")
    ]  # unknown by equation
    unmatched = [u.name for j, u in enumerate(unknowns) if j not in matching]
    if unmatched or -1 in matching:
        span = next((e.span for e, j in zip(equations, matching, strict=True) if j < 0), None)
        evaluate.fail(f"the equations do not determine {', '.join(unmatched) or 'the model'}", span)
    owner = {j: i for i, j in enumerate(matching)}
    solved: list[Assignment] = []
    for block in strongly_connected_components((range(shape[0]), [(i, owner[j]) for i, j in entries])):
        rows_of_block = sorted(block)
        solved += _solved(
            evaluate, [equations[i] for i in rows_of_block], [unknowns[matching[i]] for i in rows_of_block]
        )
    return solved


def _solved(
    evaluate: Evaluator, equations: Sequence[Residual], unknowns: Sequence[sp.Symbol]
) -> list[Assignment]:
    names = ", ".join(u.name for u in unknowns)
    form = linear([e.value for e in equations], unknowns, set(unknowns))
    if form is None:
        evaluate.refuse(f"nonlinear equation for {names}", equations[0].span)
    matrix, rest = form
    if matrix.rank() < len(unknowns):
        evaluate.refuse(f"singular equation for {names}", equations[0].span)
    if len(unknowns) == 1:
        return [(unknowns[0], -rest[0] / matrix[0])]
    return list(zip(unknowns, matrix.LUsolve(-rest), strict=True))
