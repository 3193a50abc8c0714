"""What happens at sampling times, and delays: `when sample(start, period)` and `delay` of held signals.

In go the `when` of the model and the delays met in its equations. Out come clocks, what is assigned when
each of them ticks, in the order of computation, and delays of quantities that are held between samples.
"""

from __future__ import annotations

import graphlib
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
import sympy as sp

from lpfcosim.modelica.evaluate import Evaluator
from lpfcosim.modelica.expressions import TIME
from lpfcosim.modelica.sources import Node
from lpfcosim.modelica.system import Delay, Event


def clocks(evaluate: Evaluator) -> tuple[tuple[sp.Expr, sp.Expr], ...]:
    """Return start and period of each clock."""
    return tuple((evaluate(w.start)[()], evaluate(w.period)[()]) for w in evaluate.model.whens)


def events(evaluate: Evaluator, resolved: Mapping[sp.Symbol, sp.Expr]) -> tuple[Event, ...]:
    """Return what is assigned at the ticks, algebraic variables being ``resolved``."""
    found: dict[sp.Symbol, Event] = {}
    for clock, when in enumerate(evaluate.model.whens):
        for target, tree, span in when.assignments:
            for symbol, value in zip(np.ravel(evaluate.value(target)), np.ravel(evaluate(tree)), strict=True):
                if symbol in found:
                    evaluate.refuse(f"second 'when' for '{target}'", span)
                found[symbol] = Event(symbol, value.xreplace(resolved), clock, span)
    previous = {f"pre({s.name})" for s in found}
    for event in found.values():
        for s in event.value.free_symbols:
            if s.name.startswith("pre(") and s.name not in previous:
                evaluate.refuse(f"{s.name} of a variable that is not sampled", event.span)
            if s.name.startswith("der("):
                evaluate.refuse(f"{s.name} inside when", event.span)
    values = {symbol: event.value for symbol, event in found.items()}
    places = {symbol: event.span for symbol, event in found.items()}
    return tuple(found[symbol] for symbol in ordered(evaluate, values, places))


def delays(
    evaluate: Evaluator,
    resolved: Mapping[sp.Symbol, sp.Expr],
    constant: Collection[sp.Symbol],
    states: Collection[sp.Symbol],
) -> tuple[Delay, ...]:
    """Return the delays met so far, of what is held and by a time that does not vary."""
    found = []
    for delay in evaluate.delays:
        value = delay.value.xreplace(resolved)
        for s in value.free_symbols:
            if s in states or s == TIME or s.name.startswith(("delay(", "der(")):
                evaluate.refuse(
                    f"delay() of a signal that is not held between samples ({s.name})", delay.span
                )
        if not delay.duration.free_symbols <= set(constant):
            evaluate.refuse("delay() with a varying delay time", delay.span)
        found.append(replace(delay, value=value))
    return tuple(found)


def ordered(
    evaluate: Evaluator, values: Mapping[sp.Symbol, sp.Expr], places: Mapping[sp.Symbol, Node]
) -> list[sp.Symbol]:
    """Sort symbols so that the value of each needs those before it only."""
    graph = {symbol: value.free_symbols & values.keys() for symbol, value in values.items()}
    try:
        return list(graphlib.TopologicalSorter(graph).static_order())
    except graphlib.CycleError as error:
        circle = sorted({s.name for s in error.args[1]})
        evaluate.fail(f"{', '.join(circle)} depend on each other in a circle", places[error.args[1][0]])
