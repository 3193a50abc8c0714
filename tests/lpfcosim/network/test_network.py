"""The order of the steps and the algebraic loops, from the connections alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lpfcosim.errors import InputError
from lpfcosim.modelica import numpy_models
from lpfcosim.models import model_of, one_axis, six_dof
from lpfcosim.network.wiring import Component, check_feedthrough, endpoint, in_order


@given(st.data())
def test_order_does_not_depend_on_how_they_are_listed(make_run, data):
    done = set()
    components = model_of(make_run()).components(make_run())
    for component in in_order(data.draw(st.permutations(components))):
        sources = {endpoint(s)[0] for s in component.inputs.values()} - {""}
        assert sources - done <= {"Plant"}
        done.add(component.model)
    assert component.model == "Plant"


def test_whole_spacecraft_is_wired_to_signals_and_outputs_that_exist(make_run):
    run = make_run(spacecraft="lpf")
    outputs = {f"{c.model}.{v}" for c in model_of(run).components(run) for v in c.outputs}
    sources = [s for c in model_of(run).components(run) for s in c.inputs.values()]
    sources += model_of(run).record.values()
    assert set(sources) <= outputs | set(model_of(run).stimuli(run))
    assert set(model_of(run).stimuli(run)) <= set(sources)
    names = [c.model for c in model_of(run).components(run)]
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
    with pytest.raises(InputError, match=r"algebraic loop: .*(A.y -> B.y|B.y -> C.y -> A.y -> B.y)"):
        check_feedthrough(components, everything)
    check_feedthrough(components, {**everything, "B": {"y": []}})


def test_signals_that_pass_each_other_in_two_components_are_no_loop():
    # A.y follows from u only, B.y from A.y, and A.z from B.y: a loop of components, not of variables.
    a = Component("A", {"u": "guidance", "v": "B.y"}, ("y", "z"))
    b = Component("B", {"u": "A.y"}, ("y",))
    check_feedthrough([a, b], {"A": {"y": ["u"], "z": ["v"]}, "B": {"y": ["u"]}})


def test_every_variable_of_a_spacecraft_model_has_one_unit():
    for model in (one_axis.MODEL, six_dof.MODEL):
        for module in map(numpy_models.load, model.models):
            units = {name: unit for name, (_, unit) in (module.PARAMETERS | module.INPUTS).items()}
            for name, unit in (units | module.OUTPUTS).items():
                assert model.units[name] == unit, (module.__name__, name)


def test_all_signals_between_models_are_joined_by_name(make_run):
    channels = 0
    for spacecraft in ("lpf-x", "lpf"):
        run = make_run(noise={"electrode": 2e-6}, spacecraft=spacecraft)
        for component in model_of(run).components(run):
            assert list(component.inputs) == list(numpy_models.load(component.model).INPUTS)
        channels += len(model_of(run).record)
    assert channels == 7 + 41
