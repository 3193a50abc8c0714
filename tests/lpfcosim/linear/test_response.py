"""The linear closed loop in the frequency domain, against the stepped one and the noise as it is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop, response
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Sine
from tests.oracles import reference_plant

CHANNELS = ("o_1", "o_12", "f_x_1", "f_x_2")
# m or m s^-2 or N: far from any limit, far above rounding
DRIVES = {
    "n_1": 1e-10,
    "n_12": 1e-10,
    "g_1": 1e-12,
    "g_2": 1e-12,
    "F_noise_x_sc": 1e-7,
    "f_x_1_jitter": 1e-12,
}
FREQUENCY = 0.05  # Hz


@pytest.fixture(scope="module")
def still(quickstart):
    """A run that nothing drives."""
    run = loading.load(quickstart).runs[1]
    return replace(run, injections=(), noise={}, dc=0.0, n_samples=40_000)


@pytest.mark.parametrize("name", DRIVES)
def test_steady_state_of_a_sine(still, name):
    t = still.time
    driven = {other: np.zeros(t.size) for other in DRIVES}
    driven[name] = DRIVES[name] * np.sin(2 * np.pi * FREQUENCY * t)
    simulated = reference_plant.simulate(still, stimuli.injections(still) | driven)
    s = ClosedLoop(still).linearize()
    H = s.frequency_response(np.array([FREQUENCY]))[0]

    late = t > t[-1] - 400  # whole cycles; what is left of the start is slow: constant and ramp take it
    angle = 2 * np.pi * FREQUENCY * t[late]
    basis = np.stack([np.sin(angle), np.cos(angle), np.ones(angle.size), t[late] - t[late].mean()], axis=1)
    for channel in CHANNELS:
        a, b, *_ = np.linalg.lstsq(basis, simulated[channel][late], rcond=None)[0]
        expected = DRIVES[name] * H[s.outputs.index(channel), s.inputs.index(name)]
        assert abs(a + 1j * b - expected) <= 1e-4 * abs(expected), channel


@pytest.mark.parametrize(("stretch", "block"), [(7, 49), (60, 3600), (1000, 1000)])
def test_response_is_that_of_one_step_after_the_other(quickstart, monkeypatch, stretch, block):
    monkeypatch.setattr(response, "CHUNK", stretch)
    monkeypatch.setattr(response, "BLOCK", block)
    run = loading.load(quickstart).runs[1]
    push = Sine("F_x_1", frequency=5e-3, amplitude=1e-12, cycles=5, start=100.0)
    run = replace(run, n_samples=17_770, injections=(*run.injections, push))
    s, w = response.recorded_system(run), stimuli.injections(run)
    columns = [i for i, name in enumerate(s.inputs) if name in w]
    inputs = np.stack([w[s.inputs[i]] for i in columns], axis=1)
    state, seen = np.zeros(len(s.A)), []
    for now in inputs:
        seen.append(s.C @ state + s.D[:, columns] @ now)
        state = s.A @ state + s.B[:, columns] @ now
    expected = np.array(seen)[::10].T
    assert np.ptp(expected, axis=1).min() > 0
    for name, x in zip(s.outputs, expected, strict=True):
        result = response.linear_response(run)[name]
        np.testing.assert_allclose(result, x, rtol=0, atol=1e-11 * np.abs(x).max(), err_msg=name)


def test_peaks_are_those_of_the_simulated_loop(quickstart):
    run = next(run for run in loading.load(quickstart).runs if run.injections)
    run = replace(run, noise={}, n_samples=36_000)
    simulated = ClosedLoop(run).simulate()
    for name, peak in response.peaks(run).items():
        assert peak == pytest.approx(np.abs(simulated[name]).max(), rel=0.01, abs=1e-30), name
