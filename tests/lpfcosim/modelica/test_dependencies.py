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


@pytest.mark.parametrize("version", VERSIONS)
def test_structure_is_that_of_the_equations(version):
    plant = read_description(archive("Plant", version)).structure
    inputs = {"f_applied_1", "f_applied_2", "F_x_sc", "g_1", "g_2", "F_noise_x_sc"}
    assert set(plant["Output"]["x_1"]) == {"testMass_1.x"}
    # Delayed commands do not reach the acceleration at once, what is not delayed does.
    assert inputs & set(plant["Output"]["a_SC"]) == {"g_1", "g_2", "F_noise_x_sc"}
    assert plant["ContinuousStateDerivative"]["der(testMass_1.x)"] == {"testMass_1.v": "constant"}
    assert plant["ContinuousStateDerivative"]["der(testMass_2.v)"]["testMass_2.x"] == "tunable"
    # At the start a delay hands on what is set; the thrusters lag behind.
    assert inputs - set(plant["InitialUnknown"]["a_SC"]) == {"F_x_sc"}
    assert set(read_description(archive("Actuation", version)).structure["Output"]["f_x_2"]) == set()
    metrology = read_description(archive("OpticalMetrology", version)).structure["Output"]["o_12"]
    assert {k: v for k, v in metrology.items() if k != "delta_ifo"} == {
        "x_1": "tunable", "x_2": "constant", "n_12": "constant",
    }  # fmt: skip
    assert ("delta_ifo" in metrology) == (version == "3.0")  # to FMI 2.0 parameters are no knowns
    assert set(read_description(archive("SuspensionControl", version)).structure["Output"]["f_control_2"]) & {
        "o_12", "guidance_o_12",
    } == set()  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("spacecraft", [None, Spacecraft()], ids=["one_axis", "six_dof"])
def test_a_tool_that_sorts_connections_sees_no_loop_around_the_spacecraft(make_run, spacecraft, version):
    previous = {}
    run = make_run(spacecraft=spacecraft)
    components = model_of(run).components(run)
    for component in components:
        with zipfile.ZipFile(archive(component.model, version)) as stored:
            root = etree.fromstring(stored.read("modelDescription.xml"))
        for variable, source in component.inputs.items():
            if endpoint(source)[0]:
                previous.setdefault((component.model, variable), set()).add(endpoint(source))
        inputs = {v.get("name") for v in root.find("ModelVariables") if v.get("causality") == "input"}
        for output, known in read_description(archive(component.model, version)).structure["Output"].items():
            previous[component.model, output] = {(component.model, v) for v in inputs & set(known)}
    order = list(graphlib.TopologicalSorter(previous).static_order())  # raises for a loop
    assert len(order) > 2 * len(components)
    # With the dependencies left open there is one.
    opened = dict(previous)
    for component in components:
        for output in component.outputs:
            opened[component.model, output] = {(component.model, v) for v in component.inputs}
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter(opened).prepare()
