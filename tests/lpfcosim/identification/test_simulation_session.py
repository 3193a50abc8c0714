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


def test_a_trial_leaves_nothing_behind(run, fmus):
    result = read_interfaces(run, fmus)
    feeds = {**stimuli.injections(run), "g_2": np.full(N, run.dc)}
    with contextlib.ExitStack() as stack:
        loop = simulation_session.load_loop(stack, run, result, ("o_1", "o_12"), SimulationProgress())
        first = loop.simulate(N, feeds, {})
        other = loop.simulate(N, feeds, {"Plant": {"omega2_2_0": -5e-7}})
        again = loop.simulate(N, feeds, {})
        short = loop.simulate(100, feeds, {})
        expected = ClosedLoop(run).simulate()
    for name, values in first.items():
        assert np.array_equal(again[name], values)
        assert np.array_equal(short[name], values[:100])
        assert np.abs(values - expected[name]).max() <= 1e-9 * np.sqrt(np.mean(expected[name] ** 2))
    assert np.abs(other["o_12"] - first["o_12"]).max() > 1e-13


def test_a_loop_goes_on_after_a_trial_that_is_not_stable(run, fmus):
    result = read_interfaces(run, fmus)
    feeds = {**stimuli.injections(run), "g_2": np.full(N, run.dc)}
    with contextlib.ExitStack() as stack:
        loop = simulation_session.load_loop(stack, run, result, ("o_1", "o_12"), SimulationProgress())
        first = loop.simulate(N, feeds, {})
        with pytest.raises(RunError, match="diverges"):
            loop.simulate(N, feeds, {"Plant": {"omega2_2_0": -1.0}})
        with pytest.raises(RunError, match="a delay is negative"):
            loop.simulate(N, feeds, {"Plant": {"tau_2": -0.05}})
        assert np.array_equal(loop.simulate(N, feeds, {})["o_12"], first["o_12"])


def test_the_controller_alone_makes_the_commands_that_it_made_in_the_loop(run, fmus):
    result = read_interfaces(run, fmus)
    feeds = {**stimuli.injections(run), "g_2": np.full(N, run.dc)}
    with contextlib.ExitStack() as stack:
        loop = simulation_session.load_loop(stack, run, result, ("o_12", "f_x_2"), SimulationProgress())
        alone = simulation_session.load_controller(stack, run, result)
        whole = loop.simulate(N, feeds, {})
        given = {"o_12": whole["o_12"], "guidance_o_12": feeds["guidance_o_12"]}
        asked = alone.simulate(N, given, {})["f_control_2"]
    assert np.abs(asked - whole["f_x_2"]).max() <= 1e-12 * np.abs(asked).max()
