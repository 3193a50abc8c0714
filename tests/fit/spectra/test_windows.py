"""Windows have the bits of `scipy.signal`; low-pass and decimation are as it has them but for rounding."""

import numpy as np
import pytest
import scipy

from fit.spectra import derivatives, windows


@pytest.mark.parametrize("size", [3, 60, 61, 21600])
def test_windows_have_the_bits_of_scipy(size):
    of_scipy = scipy.signal.windows
    np.testing.assert_array_equal(windows.hann(size), of_scipy.hann(size, sym=False))
    for taper in (0.0, 0.1, 0.35, 0.9):
        np.testing.assert_array_equal(windows.tukey(size, taper), of_scipy.tukey(size, taper))


@pytest.mark.parametrize(("size", "cut", "attenuation"), [(101, 0.03, 120), (263, 0.035, 80), (21, 0.3, 60)])
def test_the_low_pass_is_that_of_firwin(size, cut, attenuation):
    window = ("kaiser", scipy.signal.kaiser_beta(attenuation))
    wanted = scipy.signal.firwin(size, cut, window=window, fs=1)
    found = windows.low_pass(size, cut, attenuation)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-15 * wanted.max())


@pytest.mark.parametrize("fs", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("more", [-1, 0, 1, 9, 5000])
def test_decimation_is_that_of_scipy(fs, more):
    taps, factor = derivatives.low_pass(fs)
    x = np.random.default_rng(1).standard_normal(taps.size + more).cumsum()
    lost = taps.size - 1
    wanted = scipy.signal.upfirdn(taps, x, down=factor)[lost // factor : (x.size - 1) // factor + 1]
    found = derivatives.decimate(x, taps, factor)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * np.abs(x).max())
