"""The order of the steps and the algebraic loops, from the connections alone."""

import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lpfcosim.errors import InputError
from lpfcosim.models import along_x, drive, world_of
from lpfcosim.network.wiring import Component, check_feedthrough, endpoint, in_order
from lpfcosim.spacecraft.actuation import Actuation
from lpfcosim.spacecraft.run import Truth
from lpfcosim.spacecraft.spacecraft import Spacecraft


def test_order_of_ours_is_that_of_the_signals(make_run):
    names = [c.model for c in world_of(make_run()).steps(make_run())]
    assert names[0] == "OpticalMetrology"
    assert names[-2:] == ["Actuation", "Plant"]
    assert set(names) == {c.model for c in along_x.COMPONENTS}


@given(st.permutations(along_x.COMPONENTS))
def test_order_does_not_depend_on_how_they_are_listed(components):
    done = set()
    for component in in_order(components):
        sources = {endpoint(s)[0] for s in component.inputs.values()} - {""}
        assert sources - done <= {"Plant"}
        done.add(component.model)
    assert component.model == "Plant"


def test_whole_spacecraft_is_wired_to_signals_and_outputs_that_exist(make_run):
    run = make_run(spacecraft=Spacecraft())
    outputs = {f"{c.model}.{v}" for c in world_of(run).components for v in c.outputs}
    sources = [s for c in world_of(run).components for s in c.inputs.values()] + list(
        world_of(run).record.values()
    )
    assert set(sources) <= outputs | set(drive.names(run))
    assert set(drive.names(run)) <= set(sources)
    names = [c.model for c in world_of(run).steps(run)]
    assert names[-2:] == ["WholeActuation", "WholePlant"]


def chain(*links):
    """Components A, B, … of one input and one output; ``links`` names the source of each."""
    return [Component(chr(65 + i), {"u": source}, ("y",)) for i, source in enumerate(links)]


def test_components_that_wait_for_each_other_are_named():
    with pytest.raises(InputError, match=r"^algebraic loop: (A -> B -> A|B -> A -> B);"):
        in_order(chain("B.y", "A.y"))


def test_variable_that_follows_from_itself_is_named():
    components = chain("C.y", "A.y", "B.y", "guidance")
    everything = {c.model: {"y": ["u"]} for c in components}
    with pytest.raises(InputError) as refusal:
        check_feedthrough(components, everything)
    (loop,) = re.findall(r"algebraic loop: (.*);", str(refusal.value))
    nodes = loop.split(" -> ")
    assert len(nodes) == 4
    assert nodes[0] == nodes[-1]
    assert {"A.y -> B.y", "B.y -> C.y", "C.y -> A.y"} == {f"{a} -> {b}" for a, b in pairwise(nodes)}
    check_feedthrough(components, {**everything, "B": {"y": []}})


def test_signals_that_pass_each_other_in_two_components_are_no_loop():
    # A.y follows from u only, B.y from A.y, and A.z from B.y: a loop of components, not of variables.
    a = Component("A", {"u": "guidance", "v": "B.y"}, ("y", "z"))
    b = Component("B", {"u": "A.y"}, ("y",))
    check_feedthrough([a, b], {"A": {"y": ["u"], "z": ["v"]}, "B": {"y": ["u"]}})


def test_every_variable_of_a_world_has_one_unit(make_run):
    everything = {"truth": Truth(lambda_bend_2=1e-3), "actuation": Actuation(electrode=2e-6)}
    craft = Spacecraft(eta_per_x=0.4, phi_per_x=0.5)
    for run in (make_run(**everything), make_run(**everything, spacecraft=craft)):
        world = world_of(run)
        values = world.parameters(run)
        used = {n for c in world.components_of(run) for n in (*c.inputs, *c.outputs, *values[c.model])}
        assert used == set(world.units)
