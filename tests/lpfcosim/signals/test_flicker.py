"""Noise that rises as f^-1/2."""

import numpy as np
import pytest
import scipy

from lpfcosim.signals.noise import Noise, flicker, white

H = 0.1


def test_asd_is_flat_above_1_mHz_and_rises_as_the_root_below():
    f = np.geomspace(1e-5, 0.3, 500)
    asd = np.sqrt(flicker("e", 2e-6).psd(f, H))
    expected = 2e-6 * np.maximum(1, np.sqrt(1e-3 / f))
    assert np.abs(np.log(asd / expected)).max() < 0.065


@pytest.mark.stat
def test_drawn_noise_has_that_spectrum(make_run):
    """Means over bands of 80 to 900 bins of chi2: each within 5 sigma, 1e-6 by chance."""
    n = 300_000
    source = flicker("e", 2e-6)
    noise = Noise(make_run(n_samples=n), (source, white("g_1", 0.0), white("g_2", 0.0)))
    drawn = np.concatenate([noise.take(n // 2)["e"], noise.take(n // 2)["e"]])
    f, power = scipy.signal.periodogram(drawn, fs=1 / H, window="hann", detrend="constant")
    ratio = power[1:] / source.psd(f[1:], H)
    for low, high in ((3e-4, 3e-3), (3e-3, 1e-2), (1e-2, 4e-2)):
        inside = ratio[(f[1:] > low) & (f[1:] < high)]
        sigma = np.sqrt(35 / 18 / inside.size)  # of the mean, of bins that a Hann window correlates
        assert abs(inside.mean() - 1) < 5 * sigma, (low, inside.size)
