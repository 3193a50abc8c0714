"""FMUs of other tools: what is set and when, how they are stepped, which do not fit."""

import contextlib
from dataclasses import replace

import fmpy
import h5py
import numpy as np
import pytest

from lpfcosim.cosim import warnings
from lpfcosim.cosim.fmu_instance import FmuInstance
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import runner
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Replacement
from tests import third_party
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.cosim.archives import renamed, repack
from tests.lpfcosim.cosim.third_party_fmu import FMI, MODEL, placed, refusal, replacement, simulate

pytestmark = [pytest.mark.fmu]

VALUES = {
    "2.0": {"mode": 2, "enabled": True, "label": "half", "law": 2, "state": -2e-9},
    "3.0": {"mode": 2, "enabled": True, "label": "half", "law": 2, "state": -2e-9, "single": 0.25},
}


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
@pytest.mark.parametrize("macro", ["EARLY", "LATE"])
def test_typed_values_do_what_they_do_in_fmpy(run, fmus, tmp_path, fmi, macro):
    values, archive = VALUES[fmi], third_party.built(tmp_path, macro, fmi=fmi)
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


def with_step(folder, is_free, stated, *macros, fmi="2.0"):
    """Build the controller with a default step [s], which it may be stepped without, or not."""
    attribute = 'canHandleVariableCommunicationStepSize="{}"'
    changes = [
        (attribute.format("true"), attribute.format(str(is_free).lower())),
        ("<ModelVariables>", f'<DefaultExperiment stepSize="{stated}"/><ModelVariables>'),
    ]
    return third_party.built(folder, *macros, fmi=fmi, changes=changes)


@pytest.mark.parametrize(
    ("fmi", "is_free", "stated", "step"),
    [("2.0", True, 0.02, 0.0), ("3.0", False, 0.02, 0.0), ("3.0", True, 1, 0.02)],
)
def test_an_fmu_of_smaller_steps_takes_several_in_one_of_the_loop(
    run, fmus, tmp_path, fmi, is_free, stated, step
):
    archive = with_step(tmp_path, is_free, stated, "SHORT", "CHECKS_TIME", fmi=fmi)
    mine = replacement(archive, step=step)
    got = simulate(run, fmus, mine)
    run = replace(run, replacements=(mine,))
    expected = in_memory.simulate_by_fmpy(run, {**fmus, MODEL: archive}, {MODEL: 5})
    for channel, values in expected.items():  # times are rounded otherwise
        assert np.allclose(got[channel], values, rtol=0, atol=1e-12 * np.abs(values).max()), channel
    (sentence,) = warnings(placed(run, fmus, mine)[1], run.h)
    assert sentence.endswith("takes 5 steps of 0.02 s in each step of the loop, 0.1 s")


@pytest.mark.parametrize(
    ("is_free", "stated", "step", "fault"),
    [
        (True, 0.03, 0.0, ""),
        (False, 0.03, 0.0, "steps by 0.03 s; expected a step that divides that of the loop, 0.1 s"),
        (False, 0.2, 0.0, "steps by 0.2 s; expected a step that divides"),
        (True, 0.02, 0.04, "steps by 0.04 s; expected a step that divides"),
    ],
)
def test_a_step_that_does_not_divide_that_of_the_loop(run, fmus, tmp_path, is_free, stated, step, fault):
    mine = replacement(with_step(tmp_path, is_free, stated), step=step)
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


@pytest.mark.slow
@pytest.mark.parametrize("spacecraft", ["lpf-x", "lpf"])
def test_every_place_can_be_taken(run, fmus, tmp_path, spacecraft):
    run = replace(run, spacecraft=spacecraft)
    expected = in_memory.simulate(run, fmus)
    for component in model_of(run).components(run):
        names = {name: f"{name}_theirs" for name in (*component.inputs, *component.outputs)}
        archive = renamed(fmus[component.model], tmp_path / f"{component.model}.fmu", names)
        got = simulate(run, fmus, Replacement(component.model, archive, names))
        assert all(np.array_equal(got[channel], values) for channel, values in expected.items())


def test_a_library_that_does_not_load_is_refused_with_the_name_of_the_archive(run, fmus, tmp_path):
    archive = repack(
        fmus[MODEL], tmp_path / "junk.fmu", lambda n, b: b"junk" if n.startswith("binaries") else b
    )
    with pytest.raises(InputError, match=f"^{archive}: cannot be loaded"):
        simulate(run, fmus, Replacement(MODEL, archive))


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
