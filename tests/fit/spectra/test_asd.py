"""`fit.asd`, the spectral estimator of the report."""

import re

import numpy as np
import pytest

import fit


def test_the_asd_of_white_noise_scatters_by_its_standard_error():
    fs, pulls = 10.0, []
    for seed in range(8):
        x = np.random.default_rng(seed).standard_normal(20_000)
        x[500:520] = np.nan
        f, asd, sigma = fit.asd(x, fs)
        pulls.append((asd - np.sqrt(2 / fs)) / sigma)
    assert f[0] < 0.01 and f[-1] > 2.5
    pulls = np.array(pulls)[:, -15:]  # of many averages, whose distribution is nearly normal
    assert pulls.mean() == pytest.approx(0, abs=0.3)  # 15 x 8 values, neighbours correlated
    assert pulls.std() == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize(
    ("x", "fs", "message"),
    [
        (np.zeros((3, 100)), 1.0, "asd: x: expected one series of finite real numbers"),
        (["a"] * 100, 1.0, "asd: x: expected one series"),
        (np.full(100, np.inf), 1.0, "asd: x: expected one series"),
        (np.zeros(100), 0.0, "asd: fs: 0.0, expected a positive sample rate in Hz"),
        (np.zeros(100), "fast", "asd: 'fast': expected a series of numbers and its sample rate"),
        (np.zeros(10), 1.0, "asd: x: fewer than 26 samples"),
        (np.where(np.arange(100) % 2, np.nan, 1.0), 1.0, "asd: x: no stretch without missing samples"),
    ],
)
def test_what_is_no_series_has_no_asd(x, fs, message):
    with pytest.raises(fit.InputError, match=re.escape(message)):
        fit.asd(x, fs)
