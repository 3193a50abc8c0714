"""FMUs that cannot be used: what is said about them, and what is left behind."""

import contextlib
import os

import pytest

from lpfcosim.cosim import fmu_instance, interface
from lpfcosim.errors import InputError
from lpfcosim.modelica import build
from lpfcosim.network import Component
from tests.lpfcosim.cosim.archives import repack

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
