"""What an FMU says of what follows from what, against what moves when one variable is poked."""

import numpy as np
import pytest

from lpfcosim.modelica import build
from tests.lpfcosim.modelica.fmu_instance import Description, fmu_instance

pytestmark = pytest.mark.fmu
VERSIONS = ("2.0", "3.0")
ALONG_X = ("Plant", "Actuation", "OpticalMetrology", "DragFreeControl", "SuspensionControl")
CASES = [
    pytest.param(model, version, marks=() if model in ALONG_X else pytest.mark.slow)
    for model in build.MODELS
    for version in VERSIONS
]


def archive(model, version):
    return build.build([model], fmi=version)[model]


def anywhere(description, random):
    """Values of all that can be set: away from zero, parameters near their start."""
    values = {}
    for name in description.names(initial=("exact",)) + description.names(causality=("input",)):
        variable = description.variables[name]
        start = np.array(str(variable.start).split(), dtype=float)
        if variable.causality != "parameter":
            values[name] = random.uniform(0.5, 2, start.size) * random.choice([-1, 1], start.size)
        elif name != "h" and not name.endswith(".h"):
            values[name] = np.where(start, start * random.uniform(0.9, 1.1), random.uniform(0.01, 0.02))
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


@pytest.mark.parametrize(("model", "version"), CASES)
def test_nothing_moves_that_is_not_said_to_depend(model, version):
    fmu = archive(model, version)
    description = Description(fmu)
    assert None not in [d for group in description.structure.values() for d in group.values()]
    values = anywhere(description, np.random.default_rng(1))
    inputs = description.names(causality=("input",))
    running = description.structure["Output"] | description.structure["ContinuousStateDerivative"]
    initial = description.structure["InitialUnknown"]
    unaffected = set()

    def poke(name, unknowns, kinds):
        """Set a variable to another value; what moves, and what is said to move."""
        affected = changed(instance, list(unknowns), name, values[name])
        declared = {u for u, known in unknowns.items() if name in known}
        unaffected.update((u, name) for u in declared - affected if unknowns[u][name] in kinds)
        return affected, declared

    with fmu_instance(fmu, **values) as instance:
        for name in values:
            affected, declared = poke(name, initial, ("constant",))
            assert affected <= declared, name
        instance.exitInitializationMode()
        for n in range(3):
            instance.doStep(n * 0.1, 0.1)
        for name in [*inputs, *description.names(variability=("tunable",), causality=("parameter",))]:
            affected, declared = poke(name, running, ("constant", "fixed"))
            assert (version == "2.0" and name not in inputs) or affected <= declared, name
    # No dependence is declared without effect: a factor that does not vary is seen, unless rounding hides it.
    assert len(unaffected) <= 0.02 * sum(map(len, [*initial.values(), *running.values()])), unaffected
