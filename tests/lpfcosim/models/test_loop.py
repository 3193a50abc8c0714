"""Steps with inputs held, against closed forms and the exponential of SciPy."""

import numpy as np
import pytest
import scipy

from lpfcosim.models.loop import block_diagonal, held

TIMES = (0.0, 0.03, 0.1, 2.5)


def test_a_mass_falls_and_a_lag_settles():
    tau = 0.7
    rates = np.array([[0, 1, 0, 0, 1.0], [0, 0, 0, 1.0, 0], [0, 0, -1 / tau, 0, 1 / tau]])
    for t, found in zip(TIMES, held(rates, TIMES), strict=True):
        lag = np.exp(-t / tau)
        wanted = [[1, t, 0, t**2 / 2, t], [0, 1, 0, t, 0], [0, 0, lag, 0, 1 - lag]]
        assert np.allclose(found, wanted, rtol=1e-15, atol=1e-16)


@pytest.mark.parametrize("size", [1e-6, 0.1, 1.0, 5.0])
def test_it_is_the_exponential_of_scipy(size):
    rng = np.random.default_rng(3)
    n, m = 7, 3
    rates = np.zeros((n + m, n + m))
    rates[:n] = size * rng.standard_normal((n, n + m))
    rates[:n, :n] -= 3 * size * np.eye(n)
    for t, found in zip(TIMES, held(rates[:n], TIMES), strict=True):
        wanted = scipy.linalg.expm(rates * t)[:n]
        assert np.abs(found - wanted).max() <= 1e-13 * np.abs(wanted).max()


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_what_is_not_finite_has_no_step(lost):
    with pytest.raises((ValueError, OverflowError)):
        held(np.array([[lost, 1.0]]), [0.1])


def test_blocks_stand_on_the_diagonal():
    blocks = np.arange(1.0, 5).reshape(2, 2), np.array([[7.0]]), np.eye(3)
    assert np.array_equal(block_diagonal(*blocks), scipy.linalg.block_diag(*blocks))
