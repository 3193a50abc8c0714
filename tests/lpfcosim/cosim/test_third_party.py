"""FMUs of other tools: what is set and when, how they are stepped, which do not fit."""

import contextlib
from dataclasses import replace
from pathlib import Path

import fmpy
import h5py
import numpy as np
import pytest

from lpfcosim.cosim import warnings
from lpfcosim.cosim.fmu_instance import FmuInstance
from lpfcosim.errors import RunError
from lpfcosim.execution import runner
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Replacement
from tests import ROOT, third_party
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.cosim.archives import renamed
from tests.lpfcosim.cosim.third_party_fmu import FMI, MODEL, placed, refusal, replacement, simulate

pytestmark = [pytest.mark.fmu]

VALUES = [
    {"label": "half"},
    {"law": 2},
    {"single": 0.25},
    {"mode": 2, "enabled": True, "label": "full", "law": 1, "state": -2e-9},
]


def stepped(run, fmus, archive, values, n=20):
    """Output of the FMU alone, with constant inputs and typed values, after every step."""
    run, result = placed(run, fmus, replacement(archive, values=values))
    (interface,) = (i for i in result if i.model == MODEL)
    with contextlib.ExitStack() as stack:
        alone = FmuInstance(stack, interface)
        alone.initialize(interface.parameters(model_of(run).parameters(run)[MODEL]))
        alone.inputs[:] = (2e-9, 1e-9)
        alone.exchange()
        alone.exit_initialization()
        forces = []
        for i in range(n):
            alone.library.doStep(i * 0.1, 0.1)
            alone.exchange()
            forces.append(alone.outputs[0])
        return np.array(forces)


@FMI
@pytest.mark.parametrize("values", VALUES, ids=str)
@pytest.mark.parametrize("macro", ["EARLY", "LATE"])
def test_typed_values_do_what_they_do_in_fmpy(run, fmus, tmp_path, fmi, values, macro):
    if fmi == "2.0" and "single" in values:
        pytest.skip("FMI 2.0 has no type Float32")
    archive = third_party.built(tmp_path, macro, fmi=fmi)
    ours = model_of(run).parameters(run)[MODEL]
    starts = {"bandwidth": ours["f_u"], "hold": ours["f_x_2_start"], "distance": 2e-9, "wanted": 1e-9}
    times = {"stop_time": 2.0, "step_size": 0.1, "output_interval": 0.1}
    expected = fmpy.simulate_fmu(str(archive), start_values={**starts, **values}, **times)
    got = stepped(run, fmus, archive, values)
    assert np.allclose(got, expected["force"][1:], rtol=1e-12, atol=0)  # FMPy rounds times otherwise
    assert not np.allclose(got, stepped(run, fmus, archive, {}), rtol=1e-6, atol=0)


@pytest.mark.parametrize("start", [0.0, 5e-9])
def test_an_input_that_nothing_feeds_stays_at_its_start_value_and_is_listed(run, fmus, tmp_path, start):
    archive = third_party.built(tmp_path)
    names = {k: v for k, v in third_party.VARIABLES.items() if k != "guidance_o_12"}
    mine = Replacement(MODEL, archive, names, (*third_party.UNUSED, "guidance_o_12"), {"wanted": start})
    quiet = replace(run, noise={}, dc=0.0, injections=())
    assert simulate(quiet, fmus, mine)["o_12"].any() == bool(start)
    sentences = warnings(placed(quiet, fmus, mine)[1], run.h)
    assert sentences == [
        f"fmus.SuspensionControl: {archive}: open inputs, at their start values: wanted = {start}"
    ]


STEPS = {  # attributes of the description, key of the campaign, steps of 0.02 s
    "default": ('canHandleVariableCommunicationStepSize="true"', 'stepSize="0.02"', 0.0),
    "only": ('canHandleVariableCommunicationStepSize="false"', 'stepSize="0.02"', 0.0),
    "key": ('canHandleVariableCommunicationStepSize="true"', 'stepSize="1"', 0.02),
}


@FMI
@pytest.mark.parametrize("case", STEPS)
def test_an_fmu_of_smaller_steps_takes_several_in_one_of_the_loop(run, fmus, tmp_path, fmi, case):
    attribute, experiment, step = STEPS[case]
    changes = [
        ('canHandleVariableCommunicationStepSize="true"', attribute),
        ("<ModelVariables>", f"<DefaultExperiment {experiment}/><ModelVariables>"),
    ]
    archive = third_party.built(tmp_path, "SHORT", "CHECKS_TIME", fmi=fmi, changes=changes)
    mine = replacement(archive, step=step)
    got = simulate(run, fmus, mine)
    run = replace(run, replacements=(mine,))
    expected = in_memory.simulate_by_fmpy(run, {**fmus, MODEL: archive}, {MODEL: 5})
    for channel, values in expected.items():  # times are rounded otherwise
        assert np.allclose(got[channel], values, rtol=0, atol=1e-12 * np.abs(values).max()), channel
    (sentence,) = warnings(placed(run, fmus, mine)[1], run.h)
    assert sentence.endswith("takes 5 steps of 0.02 s in each step of the loop, 0.1 s")


@pytest.mark.parametrize(
    ("attribute", "stated", "step", "fault"),
    [
        ('="true"', "0.03", 0.0, ""),
        ('="false"', "0.03", 0.0, "steps by 0.03 s; expected a step that divides that of the loop, 0.1 s"),
        ('="false"', "0.2", 0.0, "steps by 0.2 s; expected a step that divides"),
        ('="true"', "0.02", 0.04, "steps by 0.04 s; expected a step that divides"),
    ],
)
def test_a_step_that_does_not_divide_that_of_the_loop(run, fmus, tmp_path, attribute, stated, step, fault):
    changes = [
        ('(canHandleVariableCommunicationStepSize)="true"', rf"\1{attribute}"),
        ("<ModelVariables>", f'<DefaultExperiment stepSize="{stated}"/><ModelVariables>'),
    ]
    mine = replacement(third_party.built(tmp_path, changes=changes), step=step)
    if fault:
        assert fault in refusal(run, fmus, mine)
    else:
        (sentence,) = warnings(placed(run, fmus, mine)[1], run.h)
        assert sentence.endswith("is stepped by 0.1 s; its default step is 0.03 s")


@pytest.mark.parametrize(
    ("macro", "fmi", "sentence"),
    [
        ("DISCARDS", "2.0", "reports 'discard' at 5.0 s"),
        ("TRACEBACK", "3.0", "reports 'fatal' at 5.0 s (ValueError: an empty table)"),
        ("TERMINATES", "3.0", "requests the end of the simulation at 5.0 s"),
        ("INFINITE", "3.0", "returns a value that is not finite at 5.0 s"),
    ],
)
def test_fmus_that_fail_say_why(run, fmus, tmp_path, macro, fmi, sentence):
    with pytest.raises(RunError) as refused:
        simulate(run, fmus, third_party.built(tmp_path, macro, fmi=fmi))
    assert str(refused.value) == f"run 'run': the SuspensionControl FMU {sentence}"


@pytest.mark.parametrize("model", build.MODELS)
@pytest.mark.slow
def test_every_place_can_be_taken(run, fmus, tmp_path, model):
    if model not in set(model_of(run).models):
        run = replace(run, spacecraft="lpf")
    component = next(c for c in model_of(run).components(run) if c.model == model)
    names = {name: f"{name}_theirs" for name in (*component.inputs, *component.outputs)}
    archive = renamed(fmus[model], tmp_path / "mine.fmu", names)
    expected = in_memory.simulate(run, fmus)
    got = simulate(run, fmus, Replacement(model, archive, names))
    assert all(np.array_equal(got[channel], values) for channel, values in expected.items())


def test_an_input_of_another_dimension_is_refused(run, fmus, tmp_path):
    changes = [('<BaseUnit m="1"/>', '<BaseUnit rad="1"/>')]
    archive = third_party.built(tmp_path, fmi="3.0", changes=changes)
    assert "by which it means rad; expected m, for o_12" in refusal(run, fmus, archive)


def test_truth_that_no_fmu_takes_is_left_out(run, fmus, tmp_path):
    # Its stiffness of test mass 2 and its cross-talk have other names, which nobody maps.
    plant = renamed(fmus["Plant"], tmp_path / "plant.fmu", {"omega2_2_0": "k", "tau_1": "delay"})
    mine = replace(run, n_samples=50, replacements=(Replacement("Plant", plant),))
    runner.write_telemetry(mine, {**fmus, "Plant": plant}, tmp_path / "one.h5", {})
    runner.write_telemetry(replace(run, n_samples=50), fmus, tmp_path / "ours.h5", {})
    with h5py.File(tmp_path / "one.h5") as one, h5py.File(tmp_path / "ours.h5") as ours:
        left_out = set(ours["truth"].attrs) - set(one["truth"].attrs)
    assert left_out == {"omega2_2_0", "omega2_2", "domega2_12", "tau_1", "C_1"}


@pytest.mark.slow
def test_controller_of_another_exporter(run, fmus, tmp_path):
    pythonfmu3 = pytest.importorskip("pythonfmu3")
    source = ROOT / "tests" / "oracles" / "suspension_controller.py"
    archive = pythonfmu3.FmuBuilder.build_FMU(source, dest=tmp_path)
    names = {
        "o_12": "distance", "guidance_o_12": "wanted", "f_control_2": "u",
        "f_u": "unity_gain", "f_x_2_start": "bias",
    }  # fmt: skip
    expected = in_memory.simulate(run, fmus)
    got = simulate(run, fmus, Replacement(MODEL, Path(archive), names))
    assert np.abs(expected["f_x_2"]).max() > 0
    for channel, values in expected.items():
        # Second-order sections with poles this close to 1 lose five digits in single outputs.
        assert np.abs(got[channel] - values).max() <= 1e-8 * np.sqrt(np.mean(values**2)), channel
