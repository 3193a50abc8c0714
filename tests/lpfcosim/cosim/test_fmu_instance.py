"""FMUs that cannot be used: what is said about them, and what is left behind."""

import contextlib
import os

import fmpy
import pytest

from lpfcosim.cosim import fmu_instance, interface
from lpfcosim.errors import InputError, RunError
from lpfcosim.modelica import build
from lpfcosim.network import Component
from tests.lpfcosim.cosim import in_memory
from tests.lpfcosim.cosim.archives import edited, repack

pytestmark = pytest.mark.fmu

MODEL = "OpticalMetrology"


def load(stack, archive):
    placed = interface.read(Component(MODEL, {"x_1": "Plant.x_1"}, ("o_1",)), archive, (), None)
    loaded = fmu_instance.FmuInstance(stack, placed)
    loaded.initialize({"delta_ifo": 0.0})


def start(archive):
    with contextlib.ExitStack() as stack:
        load(stack, archive)


def test_a_library_that_does_not_load(tmp_path):
    archive = build.build([MODEL])[MODEL]
    path = repack(archive, tmp_path / "junk.fmu", lambda n, b: b"junk" if n.startswith("binaries") else b)
    here = os.getcwd()  # noqa: PTH109
    with pytest.raises(InputError) as refusal:
        start(path)
    message = str(refusal.value)
    assert message.startswith(f"{path}: cannot be loaded: Failed to load shared library {path}")
    assert "/tmp/tmp" not in message
    assert "\n" not in message
    assert os.getcwd() == here  # noqa: PTH109


def test_an_fmu_that_refuses_to_be_instantiated_says_why(tmp_path, capfd):
    archive = build.build([MODEL])[MODEL]
    token = fmpy.read_model_description(archive).guid
    path = edited(archive, tmp_path / "other.fmu", (token, "another"))
    with pytest.raises(InputError, match=r"other\.fmu: cannot be loaded: .* is not that of this FMU\)$"):
        start(path)
    assert capfd.readouterr().out == ""


def test_an_fmu_that_refuses_to_step_says_why(make_run, capfd):
    run = make_run(truth={"C_2": 20.0})  # more than the FMU keeps
    with pytest.raises(RunError, match=r"^run 'run': .*a delay spans too many communication steps"):
        in_memory.simulate(run, build.build())
    assert capfd.readouterr().out == ""
