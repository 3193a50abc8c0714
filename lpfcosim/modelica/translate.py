"""Translate a flat Modelica model to sorted assignments, pass by pass.

1. `classify`: the kind of each variable.
2. `equations`: collected, sorted, solved.
3. `sampling`: clocks, sampled variables, delays.
4. `affine`: the linear part, for an exact step.

Each pass is a module of that name; all of them evaluate expressions through one `evaluator.Evaluator`.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from lpfcosim.modelica import affine, classify, equations, sampling, sorted_model
from lpfcosim.modelica.evaluator import TIME, Evaluator
from lpfcosim.modelica.event_functions import switches
from lpfcosim.modelica.flat_model import FlatModel
from lpfcosim.modelica.sorted_model import Assertion, Assignment, SortedModel


def translate(model: FlatModel, name: str | None = None) -> SortedModel:
    """Order and solve the equations of a flat model, called ``name`` or as its class.

    Raises
    ------
    UnsupportedError
        Naming file, line and construct: nonlinear or singular blocks, events of states, delays of signals
        that are not held, sampled variables that depend on each other in a circle.
    """
    evaluate = Evaluator(model)
    residuals = equations.collect(evaluate)
    scalars = classify.classify(evaluate, {s for e in residuals for s in e.value.free_symbols})

    def symbols(*kinds: str) -> list[sp.Symbol]:
        return [s.symbol for s in scalars if s.kind in kinds]

    states, rates = symbols("state"), symbols("rate")
    solved = equations.solve(evaluate, residuals, [*rates, *symbols("algebraic")])
    resolved = sorted_model.resolved(solved)
    derivatives = tuple((x, resolved[rate]) for x, rate in zip(states, rates, strict=True))
    _refuse_events_inside_steps(evaluate, derivatives, residuals)
    events = sampling.events(evaluate, resolved)
    delays = sampling.delays(evaluate, resolved, symbols("parameter", "calculated"), states)
    calculated = {s.symbol: s for s in scalars if s.kind == "calculated"}
    return SortedModel(
        name=name or model.name.rpartition(".")[2],
        description=model.description,
        scalars=tuple(scalars),
        calculated=tuple(
            (symbol, calculated[symbol].value)
            for symbol in sampling.sort_assignments(
                evaluate,
                {s.symbol: s.value for s in calculated.values()},
                {s.symbol: s.variable.span for s in calculated.values()},
            )
        ),
        algebraic=tuple(
            (symbol, value.xreplace({r: resolved[r] for r in rates}))
            for symbol, value in solved
            if symbol not in rates
        ),
        solved=tuple(solved),
        derivatives=derivatives,
        affine=affine.split_derivatives(
            solved, states, rates, symbols("input", "discrete"), [d.symbol for d in delays]
        ),
        delays=delays,
        clocks=sampling.clocks(evaluate),
        events=events,
        assertions=tuple(Assertion(evaluate(a.condition)[()], a.message) for a in model.assertions),
    )


def _refuse_events_inside_steps(
    evaluate: Evaluator, derivatives: Sequence[Assignment], residuals: Sequence[equations.Residual]
) -> None:
    moving = {TIME, *(x for x, _ in derivatives)}
    for state, value in derivatives:
        for switch in switches([value], moving):
            # The place reported is the first equation that switches at all; there is seldom another.
            place = next(e.span for e in residuals if switches([e.value], e.value.free_symbols))
            evaluate.fail(
                f"an event inside a step is not supported: der({state.name}) switches on {switch}", place
            )
