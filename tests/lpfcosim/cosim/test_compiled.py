"""What the compiled engine filters has the bits of NumPy's and SciPy's filters."""

import numpy as np
import pytest
import scipy

from lpfcosim.cosim import compiled
from lpfcosim.signals import autoregress, decimation

pytestmark = pytest.mark.fmu


@pytest.mark.parametrize("recursion", [compiled.autoregress, autoregress])
@pytest.mark.parametrize("rho", [0.99999, -0.5])
def test_noise_has_the_bits_of_scipys_filter(recursion, rho):
    x = 3.7e-15 * np.random.default_rng(2).standard_normal(500_000)
    expected, last = scipy.signal.lfilter([1.0], [1.0, -rho], x), 0.0
    for block in np.split(x, np.cumsum([1, 0, 7, 1000])):  # in whatever blocks
        recursion(block, rho, last)
        last = block[-1] if block.size else last
    assert x.tobytes() == expected.tobytes()


@pytest.mark.parametrize("n", [0, 1, 999])
@pytest.mark.parametrize("factor", [2, 5, 10])
def test_the_low_pass_has_the_bits_of_numpys_and_is_a_convolution(factor, n):
    taps = decimation.taps(factor)
    m = taps.size + factor * n - 1  # up to the last sample that the next output lacks
    x = np.random.default_rng(n).standard_normal((m, decimation.TOGETHER)).cumsum(axis=0)
    found, wanted = np.full((2, n, decimation.TOGETHER), np.nan)
    compiled.low_pass(taps, factor, x, found)
    decimation.plain(taps, factor, x, wanted)
    assert found.tobytes() == wanted.tobytes()
    for y, column in zip(found.T, x.T, strict=True):
        direct = scipy.signal.convolve(column, taps, mode="valid", method="direct")[::factor][:n]
        np.testing.assert_allclose(y, direct, rtol=0, atol=1e-15 * np.abs(column).max())
