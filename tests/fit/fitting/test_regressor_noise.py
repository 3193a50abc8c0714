"""The noise of read-outs that are columns: what is taken off the scores of a run."""

import numpy as np
import pytest

from fit.fitting import regressor_noise
from fit.spectra import NoiseModel, windowing
from fit.whitening import whitened_run


def test_noise_counts_by_the_bins_of_the_run_whatever_the_length_of_the_noise_run():
    # 12,000 numbers: the ratio scatters by 0.015
    rng = np.random.default_rng(4)
    short, long = (
        windowing.transform(rng.standard_normal((n, 3)), np.ones(n, dtype=bool), 1.0) for n in (20000, 60000)
    )
    white = NoiseModel(np.log([1e-5, 1e-3, 0.1]), np.full(3, np.log(2.0)), np.zeros((3, 3)))
    run = whitened_run.whiten_run(short, white, np.eye(2))
    found = regressor_noise.corrected(run, long, white, None)
    assert np.trace(found.noise_products) / np.trace(run.R.T @ run.R) == pytest.approx(1, abs=0.08)
