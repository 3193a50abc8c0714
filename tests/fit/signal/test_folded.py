"""Transforms of series that are dealt out, against those of NumPy of the whole."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy

from fit.signal import folded
from fit.threads import give_back

# so many samples, that end: dealt out to 5, 4, 3, 2 series, and not at all
CASES = [(3000, 290), (3000, 300), (1944, 300), (1701, 260), (2002, 480), (1009, 100), (1000, 499)]


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.mark.parametrize(("n", "end"), CASES)
def test_the_lowest_bins_are_those_of_the_whole_series(n, end, rng):
    x, w = rng.standard_normal((2, n))
    found = folded.transform(x, w, end)
    whole = np.fft.rfft(x * w)
    np.testing.assert_allclose(found, whole[:end], rtol=0, atol=1e-14 * np.abs(whole).max())


@pytest.mark.parametrize(("n", "end"), CASES)
def test_a_series_of_few_bins_is_that_of_all_of_them(n, end, rng):
    first = 3
    bins = rng.standard_normal(end - first) + 1j * rng.standard_normal(end - first)
    padded = np.zeros(n // 2 + 1, dtype=complex)
    padded[first:end] = bins
    found = np.empty(n)
    folded.inverse(bins, first, n, found)
    whole = np.fft.irfft(padded, n)
    np.testing.assert_allclose(found, whole, rtol=0, atol=1e-14 * np.abs(whole).max())


def resident():
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody tells what is in memory")
def test_plans_of_long_series_go_when_memory_is_given_back():
    give_back()
    before, n = resident(), 2**21
    scipy.fft.rfft(np.zeros(n))
    assert resident() - before > 4 * n  # else SciPy no longer keeps plans, and nobody has to free them
    give_back()
    assert resident() - before < 2 * n
