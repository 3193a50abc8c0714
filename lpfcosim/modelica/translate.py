"""From a flat Modelica model to a system of assignments, pass by pass.

1. `kinds`: what each variable is.
2. `equations`: gathered, put in order, solved.
3. `sampling`: clocks, what they change, and delays.
4. `affine`: whether a step can be exact.

Each pass is a file of that name; all of them read what stands in the model through one `evaluate.Evaluator`.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from lpfcosim.modelica import affine, equations, kinds, sampling
from lpfcosim.modelica.evaluate import Evaluator
from lpfcosim.modelica.events import switches
from lpfcosim.modelica.expressions import TIME
from lpfcosim.modelica.flat import FlatModel
from lpfcosim.modelica.system import Assignment, System


def translate(model: FlatModel) -> System:
    """Order and solve the equations of a flat model.

    Raises
    ------
    UnsupportedError
        Naming file, line and construct: nonlinear or singular blocks, events of states, delays of signals
        that are not held, sampled variables that depend on each other in a circle.
    """
    evaluate = Evaluator(model)
    gathered = equations.gather(evaluate)
    scalars = kinds.classify(evaluate, {s for e in gathered for s in e.value.free_symbols})

    def of(*wanted: str) -> list[sp.Symbol]:
        return [s.symbol for s in scalars if s.kind in wanted]

    states, rates = of("state"), of("rate")
    solved = equations.solve(evaluate, gathered, [*rates, *of("algebraic")])
    resolved: dict[sp.Symbol, sp.Expr] = {}
    for symbol, value in solved:
        resolved[symbol] = value.xreplace(resolved)
    derivatives = tuple((x, resolved[rate]) for x, rate in zip(states, rates, strict=True))
    _refuse_events_inside_steps(evaluate, derivatives, gathered)
    events = sampling.events(evaluate, resolved)
    delays = sampling.delays(evaluate, resolved, of("parameter", "calculated"), states)
    calculated = {s.symbol: s for s in scalars if s.kind == "calculated"}
    return System(
        name=model.name.rpartition(".")[2],
        description=model.description,
        scalars=tuple(scalars),
        calculated=tuple(
            (symbol, calculated[symbol].value)
            for symbol in sampling.ordered(
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
        affine=affine.affine(derivatives, of("input", "discrete"), [d.symbol for d in delays]),
        delays=delays,
        clocks=sampling.clocks(evaluate),
        events=events,
    )


def _refuse_events_inside_steps(
    evaluate: Evaluator, derivatives: Sequence[Assignment], gathered: Sequence[equations.Residual]
) -> None:
    moving = {TIME, *(x for x, _ in derivatives)}
    for state, value in derivatives:
        for switch in switches([value], moving):
            # The place told is the first equation that switches at all; there is seldom another.
            place = next(e.span for e in gathered if switches([e.value], e.value.free_symbols))
            evaluate.fail(
                f"an event inside a step is not supported: der({state.name}) switches on {switch}", place
            )
