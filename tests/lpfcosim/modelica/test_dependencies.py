"""What an FMU says of what follows from what, against what moves when one variable is poked."""

import graphlib
import zipfile

import numpy as np
import pytest
from lxml import etree

from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.network import endpoint
from lpfcosim.spacecraft import Spacecraft
from tests.lpfcosim.modelica.slaves import slave, told

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


def anywhere(own, random):
    """Values of all that can be set: away from zero, parameters near their start."""
    found = {}
    for name in own.names(initial=("exact",)) + own.names(causality=("input",)):
        start = float(own.variables[name]["start"])
        if own.variables[name]["causality"] != "parameter":
            found[name] = random.uniform(0.5, 2) * random.choice([-1, 1])
        else:
            found[name] = start * random.uniform(0.9, 1.1) if start else random.uniform(0.01, 0.02)
        if name == "h" or name.endswith(".h"):
            found[name] = start
    return found


def moved(made, unknowns, name, value, by):
    before = np.array(made.get(unknowns))
    made.set([name], [value + by])
    after = np.array(made.get(unknowns))
    made.set([name], [value])
    np.testing.assert_array_equal(made.get(unknowns), before)
    return {u for u, a, b in zip(unknowns, before, after, strict=True) if a != b}


@pytest.mark.parametrize(("model", "version"), CASES)
def test_nothing_moves_that_is_not_said_to_depend(model, version):
    fmu = archive(model, version)
    own = told(fmu)
    assert None not in [d for group in own.structure.values() for d in group.values()]
    values = anywhere(own, np.random.default_rng(1))
    inputs = own.names(causality=("input",))
    running = own.structure["Output"] | own.structure.get("ContinuousStateDerivative", {})
    initial = own.structure.get("InitialUnknown", {})
    silent, seen = set(), set()
    with slave(fmu, **values) as made:
        for name, value in values.items():
            found = moved(made, list(initial), name, value, 0.25 * value)
            said = {u for u, d in initial.items() if name in d}
            assert found <= said, name
            whole = own.array(name)
            seen |= {(own.array(u), whole, "") for u in found}
            silent |= {(own.array(u), whole, "") for u in said - found if initial[u][name] == "constant"}
        made.exitInitializationMode()
        for n in range(3):
            made.doStep(n * 0.1, 0.1)
        for name in [*inputs, *own.names(variability=("tunable",), causality=("parameter",))]:
            found = moved(made, list(running), name, values[name], 0.25 * values[name])
            said = {u for u, d in running.items() if name in d}
            assert (version == "2.0" and name not in inputs) or found <= said, name
            whole = own.array(name)
            seen |= {(own.array(u), whole, "running") for u in found}
            silent |= {
                (own.array(u), whole, "running")
                for u in said - found
                if running[u][name] in ("constant", "fixed")
            }
    # Nothing is said for safety's sake: a factor that does not vary is seen, unless rounding hides it.
    silent -= seen
    assert len(silent) <= 0.02 * sum(map(len, [*initial.values(), *running.values()])), silent


@pytest.mark.parametrize("version", VERSIONS)
def test_structure_is_that_of_the_equations(version):
    plant = told(archive("Plant", version)).structure
    inputs = {"f_applied_1", "f_applied_2", "F_x_sc", "g_1", "g_2", "F_noise_x_sc"}
    assert set(plant["Output"]["x_1"]) == {"testMass_1.x"}
    # Delayed commands do not reach the acceleration at once, what is not delayed does.
    assert inputs & set(plant["Output"]["a_SC"]) == {"g_1", "g_2", "F_noise_x_sc"}
    assert plant["ContinuousStateDerivative"]["der(testMass_1.x)"] == {"testMass_1.v": "constant"}
    assert plant["ContinuousStateDerivative"]["der(testMass_2.v)"]["testMass_2.x"] == "tunable"
    # At the start a delay hands on what is set; the thrusters lag behind.
    assert inputs - set(plant["InitialUnknown"]["a_SC"]) == {"F_x_sc"}
    assert set(told(archive("Actuation", version)).structure["Output"]["f_x_2"]) == set()
    metrology = told(archive("OpticalMetrology", version)).structure["Output"]["o_12"]
    assert {k: v for k, v in metrology.items() if k != "delta_ifo"} == {
        "x_1": "tunable", "x_2": "constant", "n_12": "constant",
    }  # fmt: skip
    assert ("delta_ifo" in metrology) == (version == "3.0")  # to FMI 2.0 parameters are no knowns
    assert set(told(archive("SuspensionControl", version)).structure["Output"]["f_control_2"]) & {
        "o_12", "guidance_o_12",
    } == set()  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("spacecraft", [None, Spacecraft()], ids=["one_axis", "six_dof"])
def test_a_tool_that_sorts_connections_sees_no_loop_around_the_spacecraft(make_run, spacecraft, version):
    before = {}
    run = make_run(spacecraft=spacecraft)
    components = model_of(run).components(run)
    for component in components:
        with zipfile.ZipFile(archive(component.model, version)) as stored:
            root = etree.fromstring(stored.read("modelDescription.xml"))
        for variable, source in component.inputs.items():
            if endpoint(source)[0]:
                before.setdefault((component.model, variable), set()).add(endpoint(source))
        inputs = {v.get("name") for v in root.find("ModelVariables") if v.get("causality") == "input"}
        for output, known in told(archive(component.model, version)).structure["Output"].items():
            before[component.model, output] = {(component.model, v) for v in inputs & set(known)}
    order = list(graphlib.TopologicalSorter(before).static_order())  # raises for a loop
    assert len(order) > 2 * len(components)
    # With the dependencies left open there is one.
    opened = dict(before)
    for component in components:
        for output in component.outputs:
            opened[component.model, output] = {(component.model, v) for v in component.inputs}
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(opened).prepare()
