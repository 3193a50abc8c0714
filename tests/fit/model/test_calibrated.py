"""The dynamics of a run as an earlier joint fit knows them."""

import numpy as np
import pytest

import fit
from fit.model import dynamics
from fit.model.calibrated import dynamics_of
from fit.parameters import FLIGHT
from tests.oracles.synthetic import World, pair


@pytest.fixture(scope="module")
def results():
    return fit.calibrate(pair(World(), "A"))


def test_stiffness_of_a_single_authority_is_that_of_the_fit(results):
    run, _ = pair(World(), "A")
    known = dynamics_of(run, results.joint)
    theta = dict(zip(dynamics.PARAMETERS, known.theta, strict=True))
    covariance = known.share @ known.correlation @ known.share.T
    for name in ("omega2_2", "domega2_12"):
        estimate = results.experiments["A"][name]
        assert theta[name] == pytest.approx(estimate.value, abs=0.01 * estimate.sigma)
    i = dynamics.PARAMETERS.index("omega2_2")
    sigma = results.experiments["A"]["omega2_2"].sigma
    assert np.sqrt(covariance[i, i]) / sigma == pytest.approx(1, rel=0.005)
    (warning,) = known.warnings
    assert warning.parameters == ("lambda_1", "C_1")


def test_stiffness_at_another_authority_is_not_calibrated(results):
    run, _ = pair(World(), "C")
    known = dynamics_of(run, results.joint)
    (warning,) = known.warnings
    assert {"omega2_2_0", "alpha_x_2", "alpha_phi_2"} <= {*warning.parameters}
    (F, N) = run.authority[1]
    flight = FLIGHT["omega2_2_0"].value + FLIGHT["alpha_x_2"].value * F + FLIGHT["alpha_phi_2"].value * N
    assert np.isclose(known.theta[dynamics.PARAMETERS.index("omega2_2")], flight, rtol=1e-12, atol=0)
