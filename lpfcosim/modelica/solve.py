"""Solve the equations: block-triangular form, then block by block, linear blocks only."""

from __future__ import annotations

import graphlib

import numpy as np
import sympy as sp
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from lpfcosim.modelica.evaluate import Evaluator
from lpfcosim.modelica.events import switches
from lpfcosim.modelica.flat import Node, UnsupportedError


def solve(
    evaluate: Evaluator, residuals: list[sp.Expr], spans: list[Node], unknowns: list[sp.Symbol]
) -> list[tuple[sp.Symbol, sp.Expr]]:
    """Return an assignment for every unknown, in an order in which they can be executed.

    Parameters
    ----------
    evaluate : Evaluator
        Refuses what cannot be solved.
    residuals : list of expression
        To be zero.
    spans : list of dict
        The place of each of them.
    unknowns : list of symbol
        As many as residuals.

    Raises
    ------
    UnsupportedError
        Naming the place and the unknowns of a nonlinear or singular block.
    """
    if len(residuals) != len(unknowns):
        raise UnsupportedError(
            f"{evaluate.model.name}: {len(residuals)} equations for {len(unknowns)} unknowns"
        )
    if not unknowns:
        return []
    column = {u: j for j, u in enumerate(unknowns)}
    entries = [(i, column[s]) for i, r in enumerate(residuals) for s in r.free_symbols if s in column]
    n = len(unknowns)
    rows, columns = np.array(entries, dtype=np.int32).reshape(-1, 2).T
    incidence = csr_array((np.ones(len(entries), dtype=np.int8), (rows, columns)), shape=(n, n))
    match = maximum_bipartite_matching(incidence, perm_type="column")
    if (match < 0).any():
        where = evaluate.model.sources.where(spans[int(np.argmin(match))])
        left = ", ".join(u.name for j, u in enumerate(unknowns) if j not in set(match))
        raise UnsupportedError(f"{where}: {evaluate.model.name}: the equations do not determine {left}")
    owner = {int(j): i for i, j in enumerate(match)}  # unknown j is solved from equation owner[j]
    links = csr_array(
        (np.ones(len(entries), dtype=np.int8), (rows, [owner[int(j)] for j in columns])), shape=(n, n)
    )
    _, label = connected_components(links, connection="strong")
    graph: dict[int, set[int]] = {int(b): set() for b in label}
    for i, j in entries:
        a, b = int(label[i]), int(label[owner[j]])
        if a != b:
            graph[a].add(b)
    members: dict[int, list[int]] = {}
    for i in range(n):
        members.setdefault(int(label[i]), []).append(i)
    solved: list[tuple[sp.Symbol, sp.Expr]] = []
    for block in graphlib.TopologicalSorter(graph).static_order():
        rows_ = members[block]
        solved += _solve_block(
            evaluate, [residuals[i] for i in rows_], [unknowns[int(match[i])] for i in rows_], spans[rows_[0]]
        )
    return solved


def _solve_block(
    evaluate: Evaluator, residuals: list[sp.Expr], unknowns: list[sp.Symbol], span: Node
) -> list[tuple[sp.Symbol, sp.Expr]]:
    matrix = sp.Matrix(residuals).jacobian(unknowns)
    names = ", ".join(u.name for u in unknowns)
    if (
        matrix.free_symbols & set(unknowns)
        or matrix.atoms(sp.Derivative, sp.Subs)
        or switches(residuals, set(unknowns))
    ):
        evaluate.refuse(span, f"nonlinear equation for {names}")
    rest = sp.Matrix(residuals).xreplace(dict.fromkeys(unknowns, sp.S.Zero))
    if matrix.rank() < len(unknowns):
        evaluate.refuse(span, f"singular equation for {names}")
    if len(unknowns) == 1:
        return [(unknowns[0], -rest[0] / matrix[0])]
    return list(zip(unknowns, matrix.LUsolve(-rest), strict=True))
