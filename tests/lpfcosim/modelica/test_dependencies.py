"""What an FMU says of what follows from what, against what moves when one variable is poked."""

import numpy as np
import pytest

from lpfcosim.modelica import build
from tests.lpfcosim.modelica.fmu_instance import Description, fmu_instance

pytestmark = pytest.mark.fmu
ALONG_X = ("Plant", "Actuation", "OpticalMetrology", "DragFreeControl", "SuspensionControl")
MODELS = [pytest.param(model, marks=() if model in ALONG_X else pytest.mark.slow) for model in build.MODELS]


def anywhere(description, random):
    """Values of all that can be set: away from zero, parameters near their start."""
    values = {}
    for name in description.names(initial=("exact",)) + description.names(causality=("input",)):
        variable = description.variables[name]
        start = float(variable.start)
        if variable.causality != "parameter":
            values[name] = random.uniform(0.5, 2) * random.choice([-1, 1])
        elif name != "h" and not name.endswith(".h"):
            values[name] = start * random.uniform(0.9, 1.1) if start else random.uniform(0.01, 0.02)
        else:
            values[name] = start
    return values


def changed(instance, unknowns, name, value):
    """Names of the unknowns that change with a variable."""
    previous = [instance.get([u]) for u in unknowns]
    instance.set([name], [1.25 * value])
    following = [instance.get([u]) for u in unknowns]
    instance.set([name], [value])
    assert [instance.get([u]) for u in unknowns] == previous
    return {u for u, a, b in zip(unknowns, previous, following, strict=True) if a != b}


@pytest.mark.parametrize("model", MODELS)
def test_nothing_moves_that_is_not_said_to_depend(model):
    archive = build.build([model])[model]
    description = Description(archive)
    assert None not in [d for group in description.structure.values() for d in group.values()]
    values = anywhere(description, np.random.default_rng(1))
    running = description.structure["Outputs"] | description.structure["Derivatives"]
    initial = description.structure["InitialUnknowns"]
    moved = set()

    def poke(name, unknowns):
        affected = changed(instance, list(unknowns), name, values[name])
        assert affected <= {u for u, knowns in unknowns.items() if name in knowns}, name
        moved.update((u, name) for u in affected)

    with fmu_instance(archive, **values) as instance:
        for name in values:
            poke(name, initial)
        instance.exitInitializationMode()
        for n in range(3):
            instance.doStep(n * 0.1, 0.1)
        for name in description.names(causality=("input",)):
            poke(name, running)
    # All that is declared is seen to move, but the pole of an integrator: one at any sampling period.
    declared = {(u, k) for u, knowns in initial.items() for k in knowns}
    assert {(u.rpartition(".")[2], k) for u, k in declared - moved} <= {("discretePole[1]", "h")}
