"""Noise in read-outs of motion: sigmas that include its effect, estimates without it."""

from types import SimpleNamespace

import numpy as np
import pytest

from fit.crosstalk.attenuation import (
    AttenuationCorrected,
    correct_joint,
    inflate_sigma,
    iv_parameters,
)
from fit.results import Fit
from fit.results.estimates import Estimate

NAMES = ("lambda_2", "delta_ifo_1", "delta_ifo_2")
EXPECTED = np.array([0.02, np.nan, 0.02])  # shift of least squares


def fit_of(names, sigma, correlation=0.0):
    covariance = np.outer(sigma, sigma) * (np.eye(len(names)) * (1 - correlation) + correlation)
    estimates = {name: Estimate(1.0, float(s), "1") for name, s in zip(names, sigma, strict=True)}
    return Fit(estimates, covariance, 1.0, 1, True, ())


def outcome(theta, sigma):
    """Return a fit of `NAMES`."""
    solution = SimpleNamespace(theta=np.array(theta), sigma=np.array(sigma))
    return SimpleNamespace(parameters=[SimpleNamespace(name=name) for name in NAMES], solution=solution)


LEAST_SQUARES = outcome([1.0] * 3, [0.1] * 3)


def test_sigmas_include_the_expected_shift():
    fit = fit_of(("b_3", "b_4", "b_5"), np.array([1.0, 1.0, 1.0]), 0.2)
    inflated = inflate_sigma(fit, {"b_3": 9.0})
    assert inflated.parameters["b_3"].sigma == pytest.approx(np.sqrt(10))
    assert inflated.parameters["b_4"] == inflated.parameters["b_5"] == Estimate(1.0, 1.0, "1")
    assert np.sqrt(np.diag(inflated.covariance_matrix)) == pytest.approx([np.sqrt(10), 1, 1])
    assert inflated.covariance_matrix[0, 1] == pytest.approx(0.2)
    inflated = inflate_sigma(fit_of(("b_3", "b_4", "b_5"), np.array([1.0, 2.0, 3.0])), {"b_4": float("nan")})
    assert list(inflated.parameters) == ["b_3", "b_5"]
    assert np.sqrt(np.diag(inflated.covariance_matrix)) == pytest.approx([1, 3])


def test_shifted_estimates_are_those_with_instruments():
    joint = fit_of(NAMES, np.array([0.1, 0.2, 0.1]), 0.5)  # scatter has widened one of them
    solution = outcome([0.98, 1.3, 1.005], [0.09, 0.12, 0.2])
    corrected = AttenuationCorrected(solution, {"b_3_1"}, np.zeros(3), EXPECTED)
    fit = correct_joint(joint, LEAST_SQUARES, corrected)
    assert fit.parameters["lambda_2"] == Estimate(pytest.approx(0.98), pytest.approx(0.1), "1")
    assert fit.parameters["delta_ifo_1"] == Estimate(pytest.approx(1.3), pytest.approx(0.2 * 1.2), "1")
    assert fit.parameters["delta_ifo_2"] == joint.parameters["delta_ifo_2"]  # it has not moved
    assert np.sqrt(np.diag(fit.covariance_matrix)) == pytest.approx([0.1, 0.2 * 1.2, 0.1])
    assert np.allclose(fit.correlation, joint.correlation)
    (warning,) = fit.warnings
    assert (warning.code, warning.parameters) == ("instrumental_variables", ("lambda_2", "delta_ifo_1"))
    assert "lambda_2 (+0.2), delta_ifo_1 (-3.0)" in warning.message
    assert iv_parameters(fit) == {"lambda_2", "delta_ifo_1"}
    # what moved is chance where no shift was to be expected
    by_chance = AttenuationCorrected(solution, {"b_3_1"}, np.zeros(3), np.zeros(3))
    assert correct_joint(joint, LEAST_SQUARES, by_chance) is joint
