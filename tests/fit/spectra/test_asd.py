"""`fit.asd`, the spectral estimator of the report."""

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
