"""Spectra in logarithmic bins: level, error bars that cover what they should, tones that stay narrow."""

import numpy as np
import pytest
from scipy import signal

from fit.spectra.averaged_spectra import Estimator

FS = 10.0


def everywhere(n):
    return np.ones(n, dtype=bool)


@pytest.mark.stat
@pytest.mark.parametrize("gap", [False, True], ids=["whole", "gap"])
def test_bands_cover_white_noise_as_often_as_they_say(gap):
    # 60 runs of 70 bins or so, 68.3 % each: the scatter of that is 0.8 %, so 3 % is 3.7 sigma, in either case
    # (false positives below 5e-4). Had a bin the error of one ordinate, it would be nearly 100 %.
    rng, n, level = np.random.default_rng(4), 40_000, 3e-15
    valid = everywhere(n)
    valid[9000:9400] = not gap
    estimator = Estimator(valid, FS, 1.0)
    inside = []
    for _ in range(60):
        found = estimator.asd(np.where(valid, rng.normal(scale=level * np.sqrt(FS / 2), size=n), np.nan))
        kept = found.f > 1e-3  # mean and slope are taken out of what is lower
        inside.append(np.mean((found.low < level) & (level < found.high), where=kept))
    assert np.mean(inside) == pytest.approx(0.683, abs=0.03)


def test_a_tone_keeps_its_narrow_peak():
    n, tone = 36_000, 0.2
    time = np.arange(n) / FS
    x = 1e-3 * np.random.default_rng(2).normal(size=n) + np.sin(2 * np.pi * tone * time)
    found = Estimator(everywhere(n), FS, 1.0).asd(x)
    f, psd = signal.periodogram(x, FS, window=("tukey", 0.1), detrend="linear")
    peak = int(np.argmax(found.asd * (np.abs(found.f - tone) < 0.01)))
    assert found.f[peak] == pytest.approx(f[np.argmax(psd)])
    assert found.asd[peak] == pytest.approx(np.sqrt(psd.max()), rel=2e-3)
    beside = np.abs(found.f / tone - 1) > 0.05
    assert found.asd[beside & (found.f > 0.1) & (found.f < 0.4)].max() < 1e-2 * found.asd[peak]
