"""Widths by restricted maximum likelihood, compared with what is known in closed form."""

import lmfit
import numpy as np
import pytest
from scipy import stats

from fit.fitting.joint_model import JointModel
from fit.fitting.random_effects import estimate_widths, heterogeneity, weighted_mean
from fit.fitting.run_estimate import RunEstimate
from fit.results.estimates import Estimate
from tests.fit.fitting.linear_equation import LinearEquation


def fitted_mean(values, sigmas):
    """Return a fit of one common parameter, 1e-6 times the values, to experiments of these sigmas."""
    runs = [
        RunEstimate(str(i), np.array([1e-6 * x]), np.array([[1e6 / s]]), LinearEquation())
        for i, (x, s) in enumerate(zip(values, sigmas, strict=True))
    ]
    params = lmfit.Parameters()
    params.add("b_1", value=0.0)
    model = JointModel(runs)
    return model, model.fit(params).params


def test_equal_errors_give_the_variance_of_the_sample():
    # with equal errors the restricted likelihood is largest at the sample variance less that of the errors
    values = np.array([1.0, 3.0, -2.0, 4.0, 0.5])
    result = heterogeneity(*fitted_mean(values, np.full(5, 0.5)), 0)
    assert result.width == pytest.approx(1e-6 * np.sqrt(np.var(values, ddof=1) - 0.25), rel=1e-3)
    assert result.variance / result.width**2 == pytest.approx(1 / 5)
    # in closed form; a width is positive, which halves the probability of a chi^2
    ratio = np.var(values, ddof=1) / 0.25
    log_likelihood = 2 * (ratio - 1 - np.log(ratio))
    assert result.p == pytest.approx(stats.norm.sf(np.sqrt(2 * log_likelihood)), rel=1e-3, abs=0)


def test_the_width_beyond_noise_is_that_drawn():
    # the variance of 6 values has a relative error of 0.63: 5 sigma of its mean over 60 draws is 41 %
    rng, sigmas = np.random.default_rng(0), np.array([1.0, 1.0, 2.0, 1.0, 0.5, 1.0])
    weights = sigmas**-2 / np.sum(sigmas**-2)
    variances = []
    for _ in range(60):
        values = 10 * rng.standard_normal(6) + sigmas * rng.standard_normal(6)
        result = heterogeneity(*fitted_mean(values, sigmas), 0)
        variances.append(1e12 * result.width**2)
        assert result.variance / result.width**2 == pytest.approx(weights @ weights)
    assert np.mean(variances) == pytest.approx(100, abs=41)


def test_noise_has_the_stated_p_values():
    # of 120 draws 6 are below 0.05; 17 or more twice in 10,000
    rng, sigmas = np.random.default_rng(1), np.array([1.0, 2.0, 3.0, 1.0])
    p = [heterogeneity(*fitted_mean(sigmas * rng.standard_normal(4), sigmas), 0).p for _ in range(120)]
    assert np.sum(np.array(p) < 0.05) < 17


def test_two_effects_have_their_own_widths():
    rng = np.random.default_rng(3)
    columns = np.eye(400, 200), np.eye(400, 200, k=-200)
    z = rng.standard_normal(400) + columns[0] @ (5 * rng.standard_normal(200))
    z += columns[1] @ (0.8 * rng.standard_normal(200))
    estimate = estimate_widths(z, columns)
    assert estimate.widths == pytest.approx((5.0, 0.8), rel=0.2)
    assert estimate.log_likelihood > 100


def test_a_weighted_mean_by_hand():
    # weights 4 and 1: mean (4 * 1 + 1 * 2) / 5; chi2 = 0.2^2 / 0.25 + 0.8^2 / 1
    result = weighted_mean([Estimate(1.0, 0.5, "1"), Estimate(2.0, 1.0, "1")])
    assert result.mean == pytest.approx(1.2)
    assert result.sigma == result.sigma_with_scatter == pytest.approx(1 / np.sqrt(5))
    assert result.chi2_red == pytest.approx(0.8)
    assert result.p == pytest.approx(2 * stats.norm.sf(np.sqrt(0.8)))  # chi2 of one degree of freedom
    assert result.width == 0


def test_estimates_of_equal_sigma_scatter_by_the_sample_variance():
    values = np.array([1.0, 2.0, 4.0, 7.0])
    result = weighted_mean([Estimate(value, 0.5, "1") for value in values])
    assert result.width**2 == pytest.approx(np.var(values, ddof=1) - 0.25, rel=1e-3)
    assert result.sigma_with_scatter == pytest.approx(np.std(values, ddof=1) / 2, rel=1e-3)
