"""Somebody else's FMU in the place of one of ours: the variable map, and what is said if it does not fit."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.cosim import compatibility
from lpfcosim.cosim.interface import resolve
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import runner
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft.run import Noise, Replacement, Sine
from lpfcosim.spacecraft.spacecraft import Spacecraft
from tests import ROOT
from tests.campaign_text import campaign
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.cosim.archives import edited, renamed
from tests.lpfcosim.cosim.third_party_fmu import placed, refusal, simulate
from tests.odd_controller import built

pytestmark = [pytest.mark.fmu, pytest.mark.slow]


@pytest.fixture
def run(make_run):
    return make_run(
        n_samples=3000,
        noise=Noise(oms=35e-15, thruster=0.15e-6, plateau=5.6e-15, tail=1.5),
        injections=(Sine("guidance_o_12", amplitude=10e-9, frequency=0.01, cycles=2, start=10),),
        dc=4e-12,
    )


@pytest.mark.parametrize("model", build.MODELS)
def test_every_place_can_be_taken(run, fmus, tmp_path, model):
    if model not in set(model_of(run).models):
        run = replace(run, spacecraft=Spacecraft())
    component = next(c for c in model_of(run).components(run) if c.model == model)
    names = {name: f"{name}_theirs" for name in (*component.inputs, *component.outputs)}
    archive = renamed(fmus[model], tmp_path / "mine.fmu", names)
    expected = in_memory.simulate(run, fmus)
    got = simulate(run, fmus, Replacement(model, archive, names))
    assert all(np.array_equal(got[channel], values) for channel, values in expected.items())


SUSPENSION = "SuspensionControl"
UNFIT = {
    "dimension": (
        (r'<BaseUnit m="1" ?/>', '<BaseUnit rad="1"/>'),
        "variable 'o_12' is in m, by which it means rad; expected m, for o_12",
    ),
    "unit without base units": (
        (r'(?s)<Unit name="m">.*?</Unit>(.*name="\w*o_12" [^>]*unit=)"m"(.*o_12" [^>]*unit=)"m"',
         r'<Unit name="m"/><Unit name="nm"/>\1"nm"\2"nm"'),
        "variable 'o_12' is in nm, of which it does not give the base units; expected m, for o_12",
    ),
    "step": (
        (r'fixedInternalStepSize="0.1"', 'fixedInternalStepSize="0.04"'),
        "steps by 0.04 s; expected a step that divides that of the loop, 0.1 s",
    ),
    "type": (
        (r'<Float64 name="o_12" valueReference="(\d+)"[^>]*/>',
         r'<Int32 name="o_12" valueReference="\1" causality="input" start="0"/>'),
        "variable 'o_12' is of type Int32; expected Float64 for o_12",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "told"), UNFIT.values(), ids=UNFIT)
def test_what_does_not_fit_is_one_sentence(run, fmus, tmp_path, change, told):
    archive = edited(fmus[SUSPENSION], tmp_path / "mine.fmu", change, drop=["sources/"])
    message = refusal(run, fmus, Replacement(SUSPENSION, archive))
    assert message.startswith(f"fmus.SuspensionControl: {archive}: ")
    assert told in message


def test_step_of_an_fmi_2_fmu_that_takes_no_other(run, fmus, tmp_path):
    ours = build.build([SUSPENSION], fmi="2.0")[SUSPENSION]
    for step, fits in (("0.2", False), ("0.05", True)):
        archive = edited(ours, tmp_path / f"{step}.fmu", (r'stepSize="[\d.]+"', f'stepSize="{step}"'))
        if fits:
            assert simulate(run, fmus, Replacement(SUSPENSION, archive))["o_12"].any()
        else:
            assert "steps by 0.2 s" in refusal(run, fmus, Replacement(SUSPENSION, archive))


def test_variable_that_is_set_from_two_sides_is_told(run, fmus, tmp_path):
    ours = fmus[SUSPENSION]
    twin = (r'(<Float64 name="o_12" [^>]*)/>', r'\1><Alias name="twin"/></Float64>')
    alias = edited(ours, tmp_path / "alias.fmu", twin)
    told = refusal(run, fmus, Replacement(SUSPENSION, alias, {"guidance_o_12": "twin"}))
    assert "'o_12' and 'twin' are one variable; expected two" in told
    # The name of another parameter of ours: that one is then not set.
    _, interfaces = placed(run, fmus, Replacement(SUSPENSION, ours, {"f_u": "f_z"}))
    assert "f_z" in compatibility.ignored_names(interfaces)[SUSPENSION]


def test_variables_without_a_unit_are_taken_as_ours(run, fmus, tmp_path):
    archive = edited(fmus[SUSPENSION], tmp_path / "mine.fmu", (r'(name="o_12" [^>]*) unit="m"', r"\1"))
    assert np.array_equal(
        simulate(run, fmus, Replacement(SUSPENSION, archive))["o_12"], in_memory.simulate(run, fmus)["o_12"]
    )


@pytest.mark.parametrize(
    ("name", "place"),
    [("gain", 0), ("row[1]", 0), ("row[3]", 2), ("A[1,1]", 0), ("A[2,1]", 3), ("A[2, 3]", 5), ("b[1]", 0)],
)
def test_elements_of_arrays_are_counted_row_by_row(name, place):
    variables = {
        n: SimpleNamespace(name=n, shape=s)
        for n, s in (("gain", ()), ("row", (3,)), ("A", (2, 3)), ("b[1]", None))
    }
    variable, element = resolve(Path("own.fmu"), variables, name, "Plant")
    assert (variable.name, element) == (name if name in variables else name.partition("[")[0], place)


@pytest.mark.parametrize("name", ["row", "row[0]", "row[4]", "A[1]", "A[3,1]", "A[1,1,1]", "gain[1]", "c"])
def test_elements_that_are_not_there(name):
    variables = {n: SimpleNamespace(name=n, shape=s) for n, s in (("gain", ()), ("row", (3,)), ("A", (2, 3)))}
    with pytest.raises(InputError, match=r"^own\.fmu: variable '.*' is (missing|an array of 3); expected"):
        resolve(Path("own.fmu"), variables, name, "Plant")


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ("variables = {o_13 = 'y'}", '.variables: no variable "o_13", did you mean "o_12"?'),
        ("variables = {o_12 = 3}", "fmus.SuspensionControl.variables.o_12: "),
        ("variables = {o_12 = 'y', guidance_o_12 = 'y'}", '"y" stands for o_12 and for guidance_o_12'),
        ("unused = ['f_control_2']", 'fmus.SuspensionControl.unused[0]: no input or parameter "f_control_2"'),
        ("unused = ['o_12']\nvariables = {o_12 = 'y'}", '"o_12" has a place under variables too'),
        ("values = {f_u = 2e-3}", 'fmus.SuspensionControl.values: "f_u" is set by the campaign already'),
        ("values = {gain = [2]}", "fmus.SuspensionControl.values.gain: "),
        ("pathh = 'x'", "fmus.SuspensionControl.pathh: unknown key"),
        ("[spacecraft]", "fmus.SuspensionControl: the loop of this campaign has no such"),
        ("[fmus.Plant]\npath = '.'", "is not a file"),
        ("[fmus.Plant]\npath = 'no.fmu'", "no.fmu: no such file"),
        ("[fmus.Suspension]\npath = 'mine.fmu'", 'did you mean "SuspensionControl"'),
    ],
)  # fmt: skip
def test_fault_of_the_campaign_file_is_one_sentence(tmp_path, keys, sentence):
    (tmp_path / "mine.fmu").write_bytes(b"")
    file = tmp_path / "own.toml"
    table = f'[fmus.SuspensionControl]\npath = "mine.fmu"\n{keys}\n'
    file.write_text(campaign('duration = "60 s"', tables=table))
    with pytest.raises(InputError) as refusal:
        loading.load(file)
    assert str(refusal.value).startswith(f"{file}: ")
    assert sentence in str(refusal.value)


def test_truth_that_no_fmu_takes_is_left_out(run, fmus, tmp_path):
    # Its stiffness of test mass 2 and its cross-talk have other names, which nobody maps.
    plant = renamed(fmus["Plant"], tmp_path / "plant.fmu", {"omega2_2_0": "k", "tau_1": "delay"})
    replacement = Replacement("Plant", plant)
    mine = replace(run, n_samples=50, replacements=(replacement,))
    runner.write_telemetry(mine, {**fmus, "Plant": plant}, tmp_path / "one.h5", {})
    with h5py.File(tmp_path / "one.h5") as written:
        told = set(written["truth"].attrs)
    runner.write_telemetry(replace(run, n_samples=50), fmus, tmp_path / "ours.h5", {})
    with h5py.File(tmp_path / "ours.h5") as written:
        all_of_it = set(written["truth"].attrs)
    assert all_of_it - told == {"omega2_2_0", "omega2_2", "domega2_12", "tau_1", "C_1"}


@pytest.mark.parametrize(
    ("what", "told"),
    [
        (
            "return Fmi3StepResult(status=Fmi3Status.ok, terminateSimulation=late)",
            "requests the end of the simulation",
        ),
        (
            "self.f_control_2 = float('inf') if late else 0.0; return Fmi3StepResult(status=Fmi3Status.ok)",
            "returns a value that is not finite",
        ),
    ],
    ids=["ends", "infinite"],
)
def test_fmu_that_misbehaves_is_named_with_the_time(run, fmus, tmp_path, what, told, request):
    archive = built(tmp_path, f"Odd_{request.node.callspec.id.replace('-', '_')}", what)
    with pytest.raises(RunError, match=rf"^run 'run': the SuspensionControl FMU {told} at 5\.0 s"):
        simulate(run, fmus, Replacement(SUSPENSION, archive))


def test_controller_of_another_exporter(run, fmus, tmp_path):
    pythonfmu3 = pytest.importorskip("pythonfmu3")
    source = ROOT / "tests" / "oracles" / "suspension_controller.py"
    archive = pythonfmu3.FmuBuilder.build_FMU(source, dest=tmp_path)
    names = {
        "o_12": "y[1]", "guidance_o_12": "y[2]", "f_control_2": "u",
        "f_u": "unity_gain", "f_x_2_start": "bias",
    }  # fmt: skip
    expected = in_memory.simulate(run, fmus)
    got = simulate(run, fmus, Replacement(SUSPENSION, Path(archive), names))
    assert np.abs(expected["f_x_2"]).max() > 0
    for channel, values in expected.items():
        # Second-order sections with poles this close to 1 lose five digits in single outputs.
        assert np.abs(got[channel] - values).max() <= 1e-8 * np.sqrt(np.mean(values**2)), channel
