"""What an FMU says of what follows from what, against what moves when one variable is poked."""

from contextlib import ExitStack

import numpy as np
import pytest

from lpfcosim.modelica import build
from tests.oracles.fmpy_loop import Slave

pytestmark = pytest.mark.fmu
ALONG_X = ("Plant", "Actuation", "OpticalMetrology", "DragFreeControl", "SuspensionControl")
MODELS = [pytest.param(model, marks=() if model in ALONG_X else pytest.mark.slow) for model in build.MODELS]


def anywhere(variables, random):
    """Values of all that can be set: away from zero, parameters near their start."""
    values = {}
    for name, variable in variables.items():
        if variable.initial != "exact" and variable.causality != "input":
            continue
        start = float(variable.start)
        if variable.causality != "parameter":
            values[name] = random.uniform(0.5, 2) * random.choice([-1, 1])
        elif name != "h" and not name.endswith(".h"):
            values[name] = start * random.uniform(0.9, 1.1) if start else random.uniform(0.01, 0.02)
        else:
            values[name] = start
    return values


def changed(slave, unknowns, name, value):
    """Names of the unknowns that change with a variable."""
    previous = slave.get(unknowns)
    slave.set({name: 1.25 * value})
    following = slave.get(unknowns)
    slave.set({name: value})
    assert slave.get(unknowns) == previous
    return {u for u, a, b in zip(unknowns, previous, following, strict=True) if a != b}


@pytest.mark.parametrize("model", MODELS)
def test_nothing_moves_that_is_not_said_to_depend(model):
    moved = set()
    with ExitStack() as stack:
        slave = Slave(stack, build.build([model])[model], {})
        description = slave.description
        variables = {v.name: v for v in description.modelVariables}
        values = anywhere(variables, np.random.default_rng(1))
        slave.set(values)
        initial, running = (
            {u.variable.name: {v.name for v in u.dependencies} for u in unknowns}
            for unknowns in (description.initialUnknowns, [*description.outputs, *description.derivatives])
        )

        def poke(name, unknowns):
            affected = changed(slave, list(unknowns), name, values[name])
            assert affected <= {u for u, knowns in unknowns.items() if name in knowns}, name
            moved.update((u, name) for u in affected)

        for name in values:
            poke(name, initial)
        slave.exitInitializationMode()
        for n in range(3):
            slave.doStep(n * 0.1, 0.1)
        for name in values:
            if variables[name].causality == "input":
                poke(name, running)
    # All that is declared is seen to move, but the pole of an integrator: one at any sampling period.
    declared = {(u, k) for u, knowns in initial.items() for k in knowns}
    assert {(u.rpartition(".")[2], k) for u, k in declared - moved} <= {("discretePole[1]", "h")}
