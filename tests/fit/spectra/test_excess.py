"""Where a correction adds noise: by hand, and how often it is said of one that does not."""

import numpy as np
import pytest

from fit.spectra.excess import Excess

DAY = 86_400


def pink(rng, n, low, high):
    """White noise of unit power in a band of frequencies at 1 Hz, silent elsewhere."""
    spectrum = np.fft.rfft(rng.standard_normal(n))
    f = np.fft.rfftfreq(n)
    return np.fft.irfft(np.where((f > low) & (f < high), spectrum, 0), n)


def bands(before, after, pieces=1):
    excess = Excess(before.size, 1.0)
    for x, y in zip(np.array_split(before, pieces), np.array_split(after, pieces), strict=True):
        excess.add(x, y)
    return excess.bands()


def test_the_band_and_the_ratio_of_what_adds_noise():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(DAY)
    (found,) = bands(x, x - 0.8 * pink(rng, DAY, 10**-2.5, 10**-2))
    low, high, ratio = found
    assert (low, high) == pytest.approx((10**-2.5, 10**-2))
    assert ratio == pytest.approx(np.sqrt(1.64), rel=0.1)


@pytest.mark.stat
def test_a_small_correction_that_is_right_is_seldom_called_noise():
    """Eight days, none of which may raise an alarm: the budget of false alarms is 1e-3 for each."""
    n_alarms = 0
    for seed in range(8):
        rng = np.random.default_rng([4, seed])
        x, correction = rng.standard_normal(DAY), 0.5 * pink(rng, DAY, 1e-4, 0.4)
        n_alarms += len(bands(x + correction, x))
    assert n_alarms == 0
