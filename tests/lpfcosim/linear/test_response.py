"""The linear closed loop in the frequency domain, against the stepped one and the noise as it is drawn."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import signal

from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop, response
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Sine
from tests.lpfcosim.linear import drives
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


def test_the_drives_have_the_spectra_they_are_drawn_with(still):
    """Means over bands of 10 draws; 5 sigma in 36 numbers: a false positive once in 48,000; seeds fixed."""
    levels = {"oms": 35e-15, "thruster": 1.5e-7, "plateau": 5e-15, "tail": 1.5, "f_x_1_jitter": 1e-14}
    segment = 16_384  # 1638 s
    power: dict[str, list] = {name: [] for name in DRIVES}
    for seed in range(10):
        drawn = stimuli.noise(replace(still, noise=levels, seed=seed, n_samples=8 * segment))
        for name in DRIVES:
            f, S = signal.welch(drawn[name], fs=still.fs, nperseg=segment, detrend="linear")
            power[name].append(S)
    expected = drives.psd(replace(still, noise=levels), f[1:])
    edges = (0.005, 0.02, 0.1, 0.5, 1.0, 2.0, 4.9)
    for name in DRIVES:
        ratio = np.mean(power[name], axis=0)[1:] / expected[name]
        for low, high in pairwise(edges):
            band = (f[1:] >= low) & (f[1:] < high)
            averages = 10 * 8 * band.sum() / 1.5  # Hann: neighbours are not independent
            assert ratio[band].mean() == pytest.approx(1, abs=5 / np.sqrt(averages) + 0.005), (name, low)


@pytest.mark.parametrize(("stretch", "block"), [(7, 49), (30, 900), (60, 3600), (1000, 1000)])
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
    run = replace(run, noise={}, n_samples=60_000)
    simulated = ClosedLoop(run).simulate()
    for name, peak in response.peaks(run).items():
        assert peak == pytest.approx(np.abs(simulated[name]).max(), rel=0.01, abs=1e-30), name
