"""What a constraint must do to the normal distribution of a fit without it."""

import numpy as np
import pytest


def conditional(free, row, value, sigma=0.0):
    """Return estimates and sigmas once a combination of them, `row`, is known to be `value` ± `sigma`."""
    theta, C = np.array(list(free.values.values())), free.covariance_matrix
    gain = C @ row / (row @ C @ row + sigma**2)
    return theta + gain * (value - row @ theta), np.sqrt(np.diag(C - np.outer(gain, row @ C)))


def row_of(free, **coefficients):
    """Return a combination of the parameters of a fit, shape (P,)."""
    return np.array([coefficients.get(name, 0.0) for name in free])


def assert_conditional(estimates, free, expected, but=()):
    """See that estimates are those expected to a fiftieth of a sigma, and sigmas to 1 %."""
    for name, value, sigma in zip(free, *expected, strict=True):
        if name not in but:
            assert estimates[name].value == pytest.approx(value, abs=0.02 * free[name].sigma), name
            assert estimates[name].sigma == pytest.approx(sigma, rel=0.01), name
