"""FMUs whose reset does not take them to their start: identification uses new instances, or says why not."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.cosim import read_interfaces
from lpfcosim.errors import RunError
from lpfcosim.identification import simulation_session
from lpfcosim.models import stimuli
from lpfcosim.spacecraft.run import Replacement, Sine
from tests import third_party

pytestmark = pytest.mark.fmu
N = 3000
MODEL = "SuspensionControl"


def simulated(make_run, fmus, archive):
    """A trial, one with another gain, the first again; of the loop at rest in between, too."""
    mine = Replacement(MODEL, archive, third_party.VARIABLES, third_party.UNUSED)
    sine = Sine("guidance_o_12", 1e-8, 0.01, 2, 10)
    run = replace(make_run(n_samples=N, injections=(sine,), dc=4e-12), replacements=(mine,))
    result = read_interfaces(run, {**fmus, MODEL: archive})
    feeds = {**stimuli.injections(run), "g_2": np.full(N, run.dc)}
    with contextlib.ExitStack() as stack:
        loop = simulation_session.load_loop(stack, run, result, ("o_12", "f_x_2"))
        return [
            loop.simulate(N, inputs, {MODEL: {"bandwidth": bandwidth}})
            for inputs, bandwidth in ((feeds, 1e-3), (feeds, 2e-3), ({}, 1e-3), (feeds, 1e-3), (feeds, 2e-3))
        ]


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize(
    "macros",
    [
        ["RESET_FAILS"],
        ["RESET_IDLE"],
        ["RESET_KEEPS_STATE"],
        ["RESET_KEEPS_TIME", "AGES"],
        ["RESET_IDLE", "CHECKS_TIME"],
        ["RESET_FAILS", "ONCE"],
        ["RESET_IDLE", "EARLY"],
    ],
    ids=" ".join,
)
def test_new_instances_take_the_place_of_a_reset(make_run, fmus, tmp_path, caplog, macros, fmi):
    caplog.set_level("INFO")
    kept = [macro for macro in macros if macro == "AGES"]
    expected = simulated(make_run, fmus, third_party.built(tmp_path, *kept, fmi=fmi, name="sound"))
    assert "new instances are used" not in caplog.text
    got = simulated(make_run, fmus, third_party.built(tmp_path, *macros, fmi=fmi))
    assert "SuspensionControl: a reset is not sufficient" in caplog.text
    for ours, theirs in zip(got, expected, strict=True):
        assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
    assert np.array_equal(got[0]["o_12"], got[3]["o_12"])


def test_fmu_that_remembers_its_instances_is_refused(make_run, fmus, tmp_path):
    memory = tmp_path / "memory"
    archive = third_party.built(tmp_path, f'REMEMBERS="{memory}"', "RESET_IDLE")
    with pytest.raises(
        RunError, match=r"ThirdParty\.fmu: does not repeat itself: after a reset, .* new instance"
    ):
        simulated(make_run, fmus, archive)
