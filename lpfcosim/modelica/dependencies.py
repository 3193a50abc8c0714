"""The dependencies that FMI asks for: the variables that reach another one along the assignments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import sympy as sp

from lpfcosim.modelica.sorted_model import Assignment, SortedModel

Dependencies = Mapping[sp.Symbol, frozenset[sp.Symbol]]


def running_dependencies(model: SortedModel) -> Dependencies:
    """Return, by calculated variable, what it depends on at a communication point."""
    return _reach([*model.calculated, *model.solved])


def initial_dependencies(model: SortedModel) -> Dependencies:
    """Return, by calculated variable, what it depends on during initialization.

    States may start where parameters say, and a delayed signal is at the start what it will be later.
    """
    starts = [
        (s.symbol, s.value) for s in model.scalars if s.kind in ("state", "discrete") and s.value.free_symbols
    ]
    delayed = [(d.symbol, d.value) for d in model.delays]
    return _reach([*model.calculated, *starts, *delayed, *model.solved])


def _reach(assignments: Iterable[Assignment]) -> Dependencies:
    reach: dict[sp.Symbol, frozenset[sp.Symbol]] = {}
    for symbol, value in assignments:
        reach[symbol] = frozenset().union(*(reach.get(s, {s}) for s in value.free_symbols))
    return reach
