"""The median, against that of numpy."""

import numpy as np
import pytest

from fit.spectra.medians import median


@pytest.mark.parametrize("n", [1, 2, 3, 10, 1001, 21600])
def test_the_median_is_that_of_numpy_to_the_bit(n):
    x = np.random.default_rng(n).standard_normal(n)
    comb = np.where(np.arange(n) % 16, x, 1e3)  # what is looked at first is nothing like the others
    endless = np.where(x > 1, np.inf, x)
    for samples in (x, np.round(x, 1), np.abs(x) * 1e-13, np.sort(x), comb, -comb, 0 * x, endless):
        before = samples.copy()
        assert median(samples) == np.median(samples)
        assert np.array_equal(samples, before)


def test_what_is_missing_has_no_median():
    assert np.isnan(median(np.array([1.0, np.nan, 2.0])))
    assert np.isnan(median(np.zeros(0)))
