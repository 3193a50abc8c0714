"""What is made part by part is what is made of the whole, bit by bit."""

import numpy as np
import pytest
import scipy

from fit.spectra import derivatives


@pytest.mark.parametrize("lost", [[], [700], [3, 4, 5], [1990, 1999]])
@pytest.mark.parametrize(("fs", "f_max", "rate"), [(10.0, 0.1, 1.0), (10.0, 1.0, 3.0), (1.0, 0.1, 1.0)])
def test_a_channel_is_reduced_in_parts_as_it_is_as_a_whole(monkeypatch, lost, fs, f_max, rate):
    x = np.random.default_rng(1).standard_normal(2000)
    x[lost] = np.nan
    taps, factor = derivatives.low_pass(fs, f_max, rate)
    whole = derivatives.preprocess(x, fs, taps, factor)
    monkeypatch.setattr(derivatives, "PIECE", 64)
    for found, expected in zip(derivatives.preprocess(x, fs, taps, factor), whole, strict=True):
        assert np.array_equal(found, expected)
    assert np.count_nonzero(whole[2]) == len(lost)


def test_stencils_are_applied_in_parts_as_to_the_whole(monkeypatch):
    x = np.random.default_rng(3).standard_normal(1000)
    weights = np.stack([derivatives.stencil(0.3, order) for order in (0, 1, 2)])
    for size in (21, 22, 500, 1000):
        expected = np.stack([derivatives.apply_stencil(w, x[:size]) for w in weights])
        with monkeypatch.context() as small:
            small.setattr(derivatives, "PIECE", 128)
            found = derivatives.apply_stencils(weights, x[:size])
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("fs", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("extra", [-1, 0, 1, 9, 5000])
def test_decimation_is_that_of_scipy(fs, extra):
    taps, factor = derivatives.low_pass(fs)
    x = np.random.default_rng(1).standard_normal(taps.size + extra).cumsum()
    order = taps.size - 1
    expected = scipy.signal.upfirdn(taps, x, down=factor)[order // factor : (x.size - 1) // factor + 1]
    decimated = derivatives.decimate(x, taps, factor)
    np.testing.assert_allclose(decimated, expected, rtol=0, atol=1e-14 * np.abs(x).max())
