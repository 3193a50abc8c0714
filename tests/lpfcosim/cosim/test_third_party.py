"""FMUs of other tools: what is set and when, what is accepted, and what is said of those that fail."""

import contextlib
import tempfile
from dataclasses import replace

import fmpy
import numpy as np
import pytest

from lpfcosim.cosim import fmu_instance, warnings
from lpfcosim.errors import RunError
from lpfcosim.models import model_of
from lpfcosim.spacecraft.run import Noise, Replacement
from tests import third_party
from tests.lpfcosim.cosim.third_party_fmu import FMI, MODEL, placed, refusal, replacement, simulate

pytestmark = [pytest.mark.fmu]


VALUES = [
    {"label": "half"},
    {"law": 2},
    {"mode": 2, "enabled": True, "label": "full", "law": "standard", "state": -2e-9},
]


def stepped(run, fmus, archive, values, n=20):
    """Output of the FMU alone, with constant inputs and typed values, after every step."""
    mine = replacement(archive, values=values)
    run, result = placed(run, fmus, mine)
    (interface,) = (i for i in result if i.model == MODEL)
    with contextlib.ExitStack() as stack:
        alone = fmu_instance.FmuInstance(stack, interface)
        alone.initialize(interface.parameters(model_of(run).parameters(run)[MODEL]))
        alone.inputs.values[:] = (2e-9, 1e-9)
        alone.exchange()
        alone.exit_initialization()
        forces = []
        for i in range(n):
            alone.library.doStep(i * 0.1, 0.1)
            alone.exchange()
            forces.append(alone.outputs.values[0])
        return np.array(forces)


@FMI
@pytest.mark.parametrize("values", VALUES, ids=str)
@pytest.mark.parametrize("macro", ["EARLY", "LATE"])
def test_typed_values_do_what_they_do_in_fmpy(run, fmus, tmp_path, fmi, values, macro):
    archive = third_party.built(tmp_path, macro, fmi=fmi)
    numbers = {name: 1 if value == "standard" else value for name, value in values.items()}
    ours = model_of(run).parameters(run)[MODEL]
    starts = {"bandwidth": ours["f_u"], "hold": ours["f_x_2_start"], "distance": 2e-9, "wanted": 1e-9}
    times = {"stop_time": 2.0, "step_size": 0.1, "output_interval": 0.1}
    expected = fmpy.simulate_fmu(str(archive), start_values={**starts, **numbers}, **times)
    assert np.array_equal(stepped(run, fmus, archive, values), expected["force"][1:])
    assert not np.array_equal(expected["force"][1:], stepped(run, fmus, archive, {}))


def test_types_of_fmi_3_alone(run, fmus, tmp_path):
    archive = third_party.built(tmp_path, "EARLY", fmi="3.0")
    hold = model_of(run).parameters(run)[MODEL]["f_x_2_start"]
    plain = stepped(run, fmus, archive, {}) - hold
    assert np.allclose(stepped(run, fmus, archive, {"single": 0.25}) - hold, 0.25 * plain, rtol=1e-9, atol=0)
    # A structural parameter is set in configuration mode, and arrays follow.
    longer = stepped(run, fmus, archive, {"order": 3, "weights[3]": 2.0}) - hold
    assert np.allclose(longer, 3.0 * plain, rtol=1e-9, atol=0)


def test_start_value_of_an_input_that_nothing_feeds(run, fmus, tmp_path):
    archive = third_party.built(tmp_path)
    unused = (*third_party.UNUSED, "guidance_o_12")
    names = {k: v for k, v in third_party.VARIABLES.items() if k != "guidance_o_12"}
    result = {}
    for start in (0.0, 5e-9):
        mine = Replacement(MODEL, archive, names, unused, {"wanted": start})
        result[start] = simulate(replace(run, noise=Noise()), fmus, mine)["o_12"]
    assert not np.array_equal(result[0.0], result[5e-9])


#: Makes `weights` an input of two elements, and a force follow from it.
WEIGHTS_AS_INPUT = [
    (r'(name="weights" valueReference="11" causality=)"parameter"', r'\1"input"'),
    (r'(<Output valueReference="4" dependencies="0) 1"', r'\1 11"'),
]


def test_values_of_an_input_array_beside_an_element_that_is_fed(run, fmus, tmp_path):
    quiet = replace(run, injections=())  # so that what is fed is zero
    archive = third_party.built(tmp_path, fmi="3.0", changes=WEIGHTS_AS_INPUT, name="array")
    names = {**third_party.VARIABLES, "guidance_o_12": "weights[1]"}
    mine = Replacement(MODEL, archive, names, third_party.UNUSED, values={"weights[2]": 7.0})
    got = simulate(quiet, fmus, mine)
    parameter = third_party.built(tmp_path, fmi="3.0")
    expected = simulate(quiet, fmus, parameter, values={"weights[1]": 0.0, "weights[2]": 7.0})
    assert np.ptp(expected["f_x_2"]) > 0
    assert all(np.array_equal(got[channel], expected[channel]) for channel in expected)


def test_variables_of_several_types_share_numbers_in_fmi_2(run, fmus, tmp_path):
    archive = third_party.built(tmp_path, changes=[('(name="mode" valueReference=)"5"', r'\1"0"')])
    placed(run, fmus, replacement(archive, values={"mode": 3}))


ARRAYS = {
    "Boolean": ('start="true false true">', "", True, [True, True, True]),
    "Boolean as digits": ('start="1 0 1">', "", False, [True, False, True]),
    "String": (">", '<Start value="a b"/><Start value=""/><Start value="c"/>', "x", ["a b", "x", "c"]),
    "Int64": ('start="9007199254740993 4 -9007199254740993">', "", 7, [2**53 + 1, 7, -(2**53) - 1]),
    "UInt64": ('start="18446744073709551615">', "", 7, [2**64 - 1, 7, 2**64 - 1]),
    "Float64": ('start="0.1 0.2 0.3">', "", 7, [0.1, 7.0, 0.3]),
}


def with_array(folder, kind, start, elements="", of=3):
    """Build an FMU that has another parameter ``items``, an array."""
    array = f'<{kind} name="items" valueReference="20" causality="parameter" {start}'
    array += f'<Dimension start="{of}"/>{elements}</{kind}>'
    return third_party.built(folder, fmi="3.0", changes=[('(<Float64 name="state")', rf"{array}\1")])


@pytest.mark.parametrize("case", ARRAYS)
def test_elements_of_arrays_of_every_type(run, fmus, tmp_path, case):
    start, elements, value, expected = ARRAYS[case]
    archive = with_array(tmp_path, case.split()[0], start, f'{elements}<Alias name="alias"/>')
    _, result = placed(run, fmus, replacement(archive, values={"alias[2]": value}))
    (interface,) = (i for i in result if i.model == MODEL)
    got = interface.start_values(interface.variable("items[1]"))
    assert (got, list(map(type, got))) == (expected, list(map(type, expected)))


@pytest.mark.parametrize(
    ("kind", "start", "of", "sentence"),
    [
        ("Float64", 'start="0.1 0.2">', 3, "has 2 start values and 3 elements; expected one value for each"),
        ("Float64", ">", 20_000, "has 20000 elements; expected at most 10000"),
        ("UInt8", 'start="1 300">', 2, 'starts at "1 300"; expected start values of type UInt8'),
        ("Boolean", 'start="true 2">', 2, 'starts at "true 2"; expected start values of type Boolean'),
    ],
)
def test_start_values_that_cannot_be_sent_are_refused_before_a_run(
    run, fmus, tmp_path, kind, start, of, sentence
):
    archive = with_array(tmp_path, kind, start, of=of)
    values = {"items[2]": True if kind == "Boolean" else 1}
    message = refusal(run, fmus, archive, values=values, validate=False)
    assert message == f'fmus.SuspensionControl: {archive}: variable "items" {sentence}'


@FMI
@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"mode": 2.5}, "values.mode: 2.5, expected an integer from "),
        ({"mode": "two"}, 'values.mode: "two", expected an integer from '),
        ({"mode": True}, "values.mode: true, expected an integer from "),
        ({"mode": 2**40}, "values.mode: 1099511627776, expected an integer from "),
        ({"enabled": 1}, "values.enabled: 1, expected true or false (type Boolean)"),
        ({"label": 3}, "values.label: 3, expected a string (type String)"),
        ({"law": "stif"}, 'values.law: "stif", did you mean "stiff"? expected one of "standard" (1)'),
        ({"law": 7}, 'values.law: 7, expected one of "standard" (1), "stiff" (2)'),
        ({"state": "x"}, 'values.state: "x", expected a number (type '),
        ({"mod": 2}, 'has no parameter "mod", which values names, did you mean "mode"?'),
        ({"cold": 2.0}, "variable 'cold' of values cannot be set: it is of causality 'calculatedParameter'"),
        ({"force": 2.0}, "variable 'force' of values cannot be set: it is of causality 'output'"),
        ({"wanted": 2.0}, "'wanted' is set by the loop and under values; expected once"),
    ],
)  # fmt: skip
def test_values_that_do_not_fit_are_one_sentence(run, fmus, tmp_path, fmi, values, sentence):
    archive = third_party.built(tmp_path, fmi=fmi)
    message = refusal(run, fmus, archive, values=values)
    assert message.startswith("fmus.SuspensionControl: ")
    assert sentence in message
    assert str(archive) in message


def test_missing_names_are_said_with_the_likely_one(run, fmus, tmp_path):
    archive = third_party.built(tmp_path, changes=[('name="force"', 'name="forces"')])
    assert refusal(run, fmus, archive).endswith(
        'as its output for f_control_2, did you mean "forces"? (known: forces)'
    )


@pytest.mark.parametrize("names", ["distance", "force", "distance|wanted|force"])
def test_float32_inputs_and_outputs(run, fmus, tmp_path, names):
    single = (rf'<Float64 (name="(?:{names})")', r"<Float32 \1")
    archive = third_party.built(tmp_path, fmi="3.0", changes=[single], name="single")
    expected = simulate(run, fmus, third_party.built(tmp_path, fmi="3.0"))
    got = simulate(run, fmus, archive)
    assert np.allclose(got["f_x_2"], expected["f_x_2"], rtol=0, atol=1e-5 * np.abs(expected["f_x_2"]).max())
    assert not np.array_equal(got["f_x_2"], expected["f_x_2"])


FAULTS = {
    "units": [(r"(?s)<UnitDefinitions>.*</UnitDefinitions>", "")],
    "no start value": [('<Real unit="m" start="0"/>', '<Real unit="m"/>')],
    "unknown attribute": [('generationTool="By hand"', 'generationTool="By hand" colour="blue"')],
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_archives_that_break_the_schema_run_where_asked_to(run, fmus, tmp_path, fault):
    archive = third_party.built(tmp_path, changes=FAULTS[fault], name="faulty")
    message = refusal(run, fmus, archive)
    assert "does not conform to the FMI schema: " in message
    assert "validate = false" in message
    mine = replacement(archive, validate=False)
    _, result = placed(run, fmus, mine)
    (warning,) = warnings(result)
    assert warning.startswith(f"fmus.SuspensionControl: {archive}: ")
    assert "does not conform to the FMI schema: " in warning
    expected = simulate(run, fmus, third_party.built(tmp_path))
    got = simulate(run, fmus, archive, validate=False)
    assert all(np.array_equal(got[channel], expected[channel]) for channel in expected)


def test_what_cannot_be_read_is_refused_all_the_same(run, fmus, tmp_path):
    archive = third_party.built(tmp_path, changes=[(r'valueReference="4"', 'valueReference="four"')])
    message = refusal(run, fmus, archive, validate=False)
    assert "not a readable FMU: " in message
    assert "validate = false" not in message


@FMI
def test_a_description_without_token_is_refused_before_it_is_loaded(run, fmus, tmp_path, fmi):
    token = "guid" if fmi == "2.0" else "instantiationToken"
    archive = third_party.built(tmp_path, changes=[(f' {token}="1"', "")], fmi=fmi)
    message = refusal(run, fmus, archive, validate=False)
    assert message.endswith(f"its modelDescription.xml has no {token}; expected one")


@pytest.mark.parametrize(
    ("macro", "sentence"),
    [("DISCARDS", "discard' at 10.0 s"), ("SPEAKS_IF_ASKED", "fatal' at 5.0 s (ValueError: an empty table)")],
)
def test_fmus_that_fail_say_why(run, fmus, tmp_path, macro, sentence):
    with pytest.raises(RunError) as refused:
        simulate(run, fmus, third_party.built(tmp_path, macro))
    assert str(refused.value) == f"run 'run': the SuspensionControl FMU reports '{sentence}"


def test_fmu_that_adds_up_its_steps_finds_the_time_that_it_is_given(run, fmus, tmp_path):
    long = replace(run, n_samples=20_000)
    assert np.isfinite(simulate(long, fmus, third_party.built(tmp_path, "CHECKS_TIME"))["o_12"]).all()


def test_resources_in_a_folder_with_a_space(run, fmus, tmp_path, monkeypatch):
    folder = tmp_path / "my läufe"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    archive = third_party.built(tmp_path, "RESOURCE", files={"resources/bandwidth.txt": "2e-3"})
    stiff = replace(run, suspension=replace(run.suspension, unity_gain=2e-3))
    names = {ours: theirs for ours, theirs in third_party.VARIABLES.items() if ours != "f_u"}
    mine = Replacement(MODEL, archive, names, third_party.UNUSED)
    got = simulate(run, fmus, mine)
    expected = simulate(stiff, fmus, third_party.built(tmp_path))
    assert np.array_equal(got["f_x_2"], expected["f_x_2"])
