"""The joint model of compressed runs, against SciPy's own minimiser on all data and closed forms."""

import numpy as np
import pytest
import scipy

from fit.fitting import JointModel, lmfit_params, parameter_values, run_estimate
from fit.model import dynamics
from fit.weighing import linear
from fit.weighing.likelihood import weights

TRUTH = np.array([1.08, 0.19, 1.05, 0.2, -4.2e-7, 1e-8, 3e-5])  # in the order of dynamics.PARAMETERS
SCALE = np.array([1e-4, 1e-3, 1e-4, 1e-3, 1e-9, 1e-9, 1e-6])
TAU = (0.1, 0.2)


def model(theta):
    """Coefficients of the columns after the first (eq. deltaglinear), delays taken off by hand."""
    lambda_1, lambda_2, C_1, C_2, omega2_2, domega2_12, delta_ifo = theta
    return np.array(
        [
            -lambda_2,
            C_2 - lambda_2 * TAU[1],
            lambda_1,
            lambda_1 * TAU[0] - C_1,
            omega2_2,
            domega2_12 - delta_ifo * omega2_2,
            -delta_ifo,
        ]
    )


@pytest.fixture(scope="module")
def driven():
    rng = np.random.default_rng(8)
    size = np.array([1.0, 1e3, 1e2, 1e3, 1e2, 1e8, 1e8, 1e5])
    U = size * (rng.standard_normal((400, 8)) + 1j * rng.standard_normal((400, 8)))
    U[:, 0] = rng.standard_normal(400) + 1j * rng.standard_normal(400) - U[:, 1:] @ model(TRUTH)
    block = linear.Block(
        TAU, U, weights("gaussian", np.arange(400.0), np.full(400, 2.0)), None, None, np.eye(7)
    )

    def residual(x):
        left = U[:, 0] + U[:, 1:] @ model(TRUTH + x * SCALE)
        return np.concatenate([left.real, left.imag])

    found = scipy.optimize.least_squares(
        residual, np.zeros(7), "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac"
    )
    return block, TRUTH + found.x * SCALE, np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac))) * SCALE


@pytest.mark.parametrize("away", [0.3, 100.0, 1e5])  # sigma
def test_minimum_is_reached_from_near_and_far(driven, away):
    block, minimum, sigma = driven
    start = minimum + away * sigma * np.array([1, -1, 1, 1, -1, 1, -1])
    model = JointModel([run_estimate("A", block)])
    result = model.fit(lmfit_params(dynamics.PARAMETERS, start, {}))
    np.testing.assert_allclose((parameter_values(result.params) - minimum) / sigma, 0, atol=1e-5)
    np.testing.assert_allclose(np.sqrt(np.diag(model.covariance(result.params))) / sigma, 1, rtol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(result.covar)) / sigma, 1, rtol=1e-4)
