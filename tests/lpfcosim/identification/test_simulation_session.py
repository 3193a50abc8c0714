"""FMUs that are loaded once and simulated again and again."""

import contextlib

import numpy as np
import pytest

from lpfcosim.cosim import SimulationProgress, read_interfaces
from lpfcosim.errors import RunError
from lpfcosim.identification import simulation_session
from lpfcosim.linear import ClosedLoop
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Sine

pytestmark = pytest.mark.fmu
N = 3000


@pytest.fixture
def run(make_run):
    return make_run(n_samples=N, injections=(Sine("guidance_o_12", 1e-8, 0.01, 2, 10),), dc=4e-12)


@pytest.fixture
def feeds(run):
    return {**stimuli.injections(run), "g_2": np.full(N, run.dc)}


@pytest.fixture
def load(run, fmus):
    """Load the loop of the run, to record some channels, or its controller alone."""
    interfaces, progress = read_interfaces(run, fmus), SimulationProgress()
    with contextlib.ExitStack() as stack:
        yield (
            lambda *record: (
                simulation_session.load_loop(stack, run, interfaces, record, progress)
                if record
                else simulation_session.load_controller(stack, run, interfaces)
            )
        )


def test_a_trial_leaves_nothing_behind(run, feeds, load):
    loop = load("o_1", "o_12")
    first = loop.simulate(N, feeds, {})
    other = loop.simulate(N, feeds, {"Plant": {"omega2_2_0": -5e-7}})
    for unstable, words in (({"omega2_2_0": -1.0}, "diverges"), ({"tau_2": -0.05}, "a delay is negative")):
        with pytest.raises(RunError, match=words):
            loop.simulate(N, feeds, {"Plant": unstable})
    again, short = (loop.simulate(n, feeds, {}) for n in (N, 100))
    expected = ClosedLoop(run).simulate()
    for name, values in first.items():
        assert np.array_equal(again[name], values)
        assert np.array_equal(short[name], values[:100])
        assert np.abs(values - expected[name]).max() <= 1e-9 * np.sqrt(np.mean(expected[name] ** 2))
    assert np.abs(other["o_12"] - first["o_12"]).max() > 1e-13


def test_the_controller_alone_makes_the_commands_that_it_made_in_the_loop(feeds, load):
    whole = load("o_12", "f_x_2").simulate(N, feeds, {})
    given = {"o_12": whole["o_12"], "guidance_o_12": feeds["guidance_o_12"]}
    asked = load().simulate(N, given, {})["f_control_2"]
    assert np.abs(asked - whole["f_x_2"]).max() <= 1e-12 * np.abs(asked).max()
