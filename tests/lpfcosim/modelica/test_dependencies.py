"""What an FMU says of what follows from what, against what moves when one variable is poked."""

import numpy as np
import pytest

from lpfcosim.modelica import build
from tests.lpfcosim.modelica.fmu_instance import fmu_instance, read_description

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
    affected = {}
    for name in description.names(initial=("exact",)) + description.names(causality=("input",)):
        start = float(description.variables[name]["start"])
        if description.variables[name]["causality"] != "parameter":
            affected[name] = random.uniform(0.5, 2) * random.choice([-1, 1])
        else:
            affected[name] = start * random.uniform(0.9, 1.1) if start else random.uniform(0.01, 0.02)
        if name == "h" or name.endswith(".h"):
            affected[name] = start
    return affected


def changed(instance, unknowns, name, value, by):
    previous = np.array(instance.get(unknowns))
    instance.set([name], [value + by])
    following = np.array(instance.get(unknowns))
    instance.set([name], [value])
    np.testing.assert_array_equal(instance.get(unknowns), previous)
    return {u for u, a, b in zip(unknowns, previous, following, strict=True) if a != b}


@pytest.mark.parametrize(("model", "version"), CASES)
def test_nothing_moves_that_is_not_said_to_depend(model, version):
    fmu = archive(model, version)
    description = read_description(fmu)
    assert None not in [d for group in description.structure.values() for d in group.values()]
    values = anywhere(description, np.random.default_rng(1))
    inputs = description.names(causality=("input",))
    running = description.structure["Output"] | description.structure.get("ContinuousStateDerivative", {})
    initial = description.structure.get("InitialUnknown", {})
    unaffected, observed = set(), set()
    with fmu_instance(fmu, **values) as instance:
        for name, value in values.items():
            affected = changed(instance, list(initial), name, value, 0.25 * value)
            declared = {u for u, d in initial.items() if name in d}
            assert affected <= declared, name
            array = description.array(name)
            observed |= {(description.array(u), array, "") for u in affected}
            unaffected |= {
                (description.array(u), array, "")
                for u in declared - affected
                if initial[u][name] == "constant"
            }
        instance.exitInitializationMode()
        for n in range(3):
            instance.doStep(n * 0.1, 0.1)
        for name in [*inputs, *description.names(variability=("tunable",), causality=("parameter",))]:
            affected = changed(instance, list(running), name, values[name], 0.25 * values[name])
            declared = {u for u, d in running.items() if name in d}
            assert (version == "2.0" and name not in inputs) or affected <= declared, name
            array = description.array(name)
            observed |= {(description.array(u), array, "running") for u in affected}
            unaffected |= {
                (description.array(u), array, "running")
                for u in declared - affected
                if running[u][name] in ("constant", "fixed")
            }
    # No dependence is declared without effect: a factor that does not vary is seen, unless rounding hides it.
    unaffected -= observed
    assert len(unaffected) <= 0.02 * sum(map(len, [*initial.values(), *running.values()])), unaffected
