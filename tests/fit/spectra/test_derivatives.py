"""What is made part by part is what is made of the whole, bit by bit."""

import numpy as np
import pytest

from fit.spectra import derivatives


@pytest.mark.parametrize("lost", [[], [700], [3, 4, 5], [1990, 1999]])
@pytest.mark.parametrize(("fs", "f_max", "rate"), [(10.0, 0.1, 1.0), (10.0, 1.0, 3.0), (1.0, 0.1, 1.0)])
def test_a_channel_is_reduced_in_parts_as_it_is_as_a_whole(monkeypatch, lost, fs, f_max, rate):
    x = np.random.default_rng(1).standard_normal(2000)
    x[lost] = np.nan
    taps, factor = derivatives.low_pass(fs, f_max, rate)
    whole = derivatives.reduced(x, fs, taps, factor)
    zeros = derivatives.decimate(np.nan_to_num(x), taps, factor)
    monkeypatch.setattr(derivatives, "PIECE", 64)
    for found, expected in zip(derivatives.reduced(x, fs, taps, factor), whole, strict=True):
        assert np.array_equal(found, expected)
    assert np.array_equal(derivatives.decimated(x, taps, factor), zeros)
    assert np.count_nonzero(whole[2]) == len(lost)


def test_stretches_of_flags_that_come_in_parts():
    flags = np.random.default_rng(2).random(500) < 0.5
    for cut in ([], [1], [100, 100, 250], [500]):
        assert np.array_equal(derivatives.stretches_of(np.split(flags, cut)), derivatives.stretches(flags))
    assert np.all(derivatives.stretches(np.ones(4, dtype=bool)) == [[0, 4]])
    assert derivatives.stretches(np.zeros(0, dtype=bool)).shape == (0, 2)


def test_stencils_are_applied_in_parts_as_to_the_whole(monkeypatch):
    x = np.random.default_rng(3).standard_normal(1000)
    weights = np.stack([derivatives.stencil(0.3, order) for order in (0, 1, 2)])
    for size in (21, 22, 500, 1000):
        expected = np.stack([derivatives.apply(w, x[:size]) for w in weights])
        with monkeypatch.context() as small:
            small.setattr(derivatives, "PIECE", 128)
            found = derivatives.apply_each(weights, x[:size])
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
