"""Whether a gain is the same in every experiment."""

import numpy as np
import pytest
from scipy import stats

from fit.quality.heterogeneity import independent_estimates, paule_mandel
from fit.results.estimates import Estimate
from fit.results.results import Fit


def estimates(values, sigmas):
    return [Estimate(v, s, "1") for v, s in zip(values, sigmas, strict=True)]


def test_two_estimates_by_hand():
    # weights 4 and 1: mean (4 * 1 + 1 * 2) / 5; chi2 = 0.2^2 / 0.25 + 0.8^2 / 1
    found = paule_mandel(estimates([1.0, 2.0], [0.5, 1.0]))
    assert found.mean == pytest.approx(1.2)
    assert found.sigma == pytest.approx(1 / np.sqrt(5))
    assert found.chi2_red == pytest.approx(0.8)
    assert found.p_value == pytest.approx(2 * stats.norm.sf(np.sqrt(0.8)))  # chi2 of one degree of freedom
    assert found.scatter == 0.0
    assert found.sigma_with_scatter == found.sigma


def test_equal_sigmas_scatter_by_the_sample_variance():
    values = np.array([1.0, 2.0, 4.0, 7.0])
    found = paule_mandel(estimates(values, [0.5] * 4))
    assert found.scatter**2 == pytest.approx(np.var(values, ddof=1) - 0.25)
    assert found.sigma_with_scatter == pytest.approx(np.std(values, ddof=1) / 2)


def test_with_the_scatter_chi2_is_one():
    values, sigmas = np.array([1.070, 1.078, 1.081, 1.086]), np.array([2e-4, 1e-3, 5e-4, 1e-4])
    found = paule_mandel(estimates(values, sigmas))
    again = paule_mandel(estimates(values, np.hypot(sigmas, found.scatter)))
    assert again.chi2_red == pytest.approx(1)
    assert again.sigma == pytest.approx(found.sigma_with_scatter)
    assert found.p_value < 1e-10


def test_estimates_that_coincide_do_not_scatter():
    found = paule_mandel(estimates([1.0] * 3, [0.1, 0.2, 0.3]))
    assert (found.chi2_red, found.scatter, found.p_value) == (0.0, 0.0, 1.0)


@pytest.mark.stat
def test_a_flight_like_scatter_is_found():
    # 13 experiments of 0.05 % that scatter by 0.5 %, as in flight: the sample standard deviation of 13 has an
    # error of 20 %, in the mean over 200 campaigns of 1.4 %; 6 % is beyond 4 sigma, seed fixed.
    rng = np.random.default_rng(11)
    sigmas = rng.uniform(3e-4, 8e-4, 13)
    found = [
        paule_mandel(
            estimates(1.0776 + 5e-3 * rng.standard_normal(13) + sigmas * rng.standard_normal(13), sigmas)
        )
        for _ in range(200)
    ]
    assert np.sqrt(np.mean([f.scatter**2 for f in found])) == pytest.approx(5e-3, rel=0.06)
    assert 60 < np.median([f.chi2_red for f in found]) < 160
    assert np.std([f.mean for f in found]) > 3 * found[0].sigma  # the plain weighted mean says too little


@pytest.mark.stat
def test_p_values_of_noise_are_uniform():
    # Kolmogorov-Smirnov over 1000 campaigns, false positives 1e-3, seed fixed
    rng = np.random.default_rng(12)
    sigmas = rng.uniform(1, 3, 13)
    p = [paule_mandel(estimates(sigmas * rng.standard_normal(13), sigmas)).p_value for _ in range(1000)]
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_an_experiment_counts_that_determines_the_parameter():
    fits = {
        experiment: Fit({name: Estimate(1.0, 0.1, "1")}, np.eye(1), 1.0, 1, True, ())
        for experiment, name in (("A", "lambda_2"), ("B", "lambda_2"), ("none", "C_2"))
    }
    assert list(independent_estimates(fits)) == ["A", "B"]
