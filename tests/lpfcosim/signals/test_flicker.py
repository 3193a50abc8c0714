"""Noise that rises as f^-1/2, and gains that change within a run."""

import numpy as np
import pytest
import scipy

from lpfcosim.signals.flicker import flicker
from lpfcosim.signals.gain_drift import GainDrift
from lpfcosim.signals.noise import Noise

H = 0.1


def test_asd_is_flat_above_1_mHz_and_rises_as_the_root_below():
    sources = flicker("e", 2e-6)
    f = np.geomspace(1e-5, 0.3, 500)
    asd = np.sqrt(sum(s.psd(f, H) for s in sources))
    expected = 2e-6 * np.maximum(1, np.sqrt(1e-3 / f))
    assert np.abs(np.log(asd / expected)).max() < 0.061
    assert {s.into for s in sources} == {"e"}
    assert flicker("e", 0.0) == ()


@pytest.mark.stat
def test_drawn_noise_has_that_spectrum(make_run):
    """Means over bands of 80 to 900 bins of chi2: each within 5 sigma, 1e-6 by chance."""
    n = 300_000
    sources = flicker("e", 2e-6)
    noise = Noise(
        make_run(n_samples=n), (*sources, GainDrift("g_1", "g_1", 0.0), GainDrift("g_2", "g_2", 0.0))
    )
    drawn = np.concatenate([noise.take(n // 2)["e"], noise.take(n // 2)["e"]])
    f, power = scipy.signal.periodogram(drawn, fs=1 / H, window="hann", detrend="constant")
    ratio = power[1:] / sum(s.psd(f[1:], H) for s in sources)
    for low, high in ((3e-4, 3e-3), (3e-3, 1e-2), (1e-2, 4e-2)):
        inside = ratio[(f[1:] > low) & (f[1:] < high)]
        sigma = np.sqrt(35 / 18 / inside.size)  # of the mean, of bins that a Hann window correlates
        assert abs(inside.mean() - 1) < 5 * sigma, (low, inside.size)


def path(run, drift, *lengths):
    stream = drift.start(run)
    return np.concatenate([stream.take(n) for n in lengths])


def test_drift_is_straight_and_zero_in_the_mean(make_run):
    run = make_run(n_samples=864_000 // 4)
    gain = path(run, GainDrift("w", "gain_2", 0.0, drift=1e-3), run.n_samples)
    middle = (run.time[0] + run.time[-1]) / 2
    np.testing.assert_allclose(gain, 1e-3 / 86_400 * (run.time - middle), rtol=0, atol=1e-15)


@pytest.mark.stat
def test_random_walk_has_its_width_and_any_blocks_give_it(make_run):
    """Half an hour of 400 walks: the mean square is within 5 sigma (1e-6 by chance)."""
    ends = []
    for seed in range(400):
        run = make_run(n_samples=18_000, seed=seed)
        stream = GainDrift("w", "gain_2", 1e-3).start(run)
        ends.append(stream._values[-1] - stream._values[0])
    assert np.mean(np.square(ends)) == pytest.approx(1e-6 / 48, rel=5 * np.sqrt(2 / 400))
    run = make_run(n_samples=5000, seed=3)
    whole = path(run, GainDrift("w", "gain_2", 1e-3), 5000)
    assert abs(whole.mean()) < 1e-18
    np.testing.assert_array_equal(whole, path(run, GainDrift("w", "gain_2", 1e-3), 17, 2983, 2000))
