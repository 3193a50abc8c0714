"""Clocks, sampled assignments and delays: ``when sample(start, period)`` and ``delay`` of sampled signals."""

from __future__ import annotations

import graphlib
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
import sympy as sp

from lpfcosim.modelica.evaluator import TIME, Evaluator
from lpfcosim.modelica.sorted_model import Delay, Event
from lpfcosim.modelica.sources import Node


def clocks(evaluate: Evaluator) -> tuple[tuple[sp.Expr, sp.Expr], ...]:
    """Return start and period of each clock."""
    return tuple((evaluate(w.start)[()], evaluate(w.period)[()]) for w in evaluate.model.whens)


def events(evaluate: Evaluator, resolved: Mapping[sp.Symbol, sp.Expr]) -> tuple[Event, ...]:
    """Return the assignments at the ticks of the clocks, algebraic variables replaced as in ``resolved``."""
    assigned: dict[sp.Symbol, Event] = {}
    for clock, when in enumerate(evaluate.model.whens):
        for target, tree, span in when.assignments:
            for symbol, value in zip(np.ravel(evaluate.value(target)), np.ravel(evaluate(tree)), strict=True):
                if symbol in assigned:
                    evaluate.refuse(f"second 'when' for '{target}'", span)
                assigned[symbol] = Event(symbol, value.xreplace(resolved), clock, span)
    previous = {f"pre({s.name})" for s in assigned}
    for event in assigned.values():
        for s in event.value.free_symbols:
            if s.name.startswith("pre(") and s.name not in previous:
                evaluate.refuse(f"{s.name} of a variable that is not sampled", event.span)
            if s.name.startswith("der("):
                evaluate.refuse(f"{s.name} inside when", event.span)
    values = {symbol: event.value for symbol, event in assigned.items()}
    places = {symbol: event.span for symbol, event in assigned.items()}
    return tuple(assigned[symbol] for symbol in sort_assignments(evaluate, values, places))


def delays(
    evaluate: Evaluator,
    resolved: Mapping[sp.Symbol, sp.Expr],
    constant: Collection[sp.Symbol],
    states: Collection[sp.Symbol],
) -> tuple[Delay, ...]:
    """Return the delays met so far; each is of a sampled signal and by a constant time."""
    checked = []
    for delay in evaluate.delays:
        value = delay.value.xreplace(resolved)
        for s in value.free_symbols:
            if s in states or s == TIME or s.name.startswith(("delay(", "der(")):
                evaluate.refuse(
                    f"delay() of a signal that is not held between samples ({s.name})", delay.span
                )
        if not delay.duration.free_symbols <= set(constant):
            evaluate.refuse("delay() with a varying delay time", delay.span)
        checked.append(replace(delay, value=value))
    return tuple(checked)


def sort_assignments(
    evaluate: Evaluator, values: Mapping[sp.Symbol, sp.Expr], places: Mapping[sp.Symbol, Node]
) -> list[sp.Symbol]:
    """Sort symbols so that the value of each needs those before it only."""
    # sorted, so that the same model gives the same order in every process
    graph = {s: sorted(value.free_symbols & values.keys(), key=str) for s, value in values.items()}
    try:
        return list(graphlib.TopologicalSorter(graph).static_order())
    except graphlib.CycleError as error:
        names = sorted({s.name for s in error.args[1]})
        evaluate.fail(f"{', '.join(names)} depend on each other in a circle", places[error.args[1][0]])
