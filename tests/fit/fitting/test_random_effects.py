"""Widths by restricted maximum likelihood, compared with what is known in closed form."""

import numpy as np
import pytest

from fit.fitting.random_effects import estimate_widths, heterogeneity


def test_equal_errors_give_the_variance_of_the_sample():
    # with equal errors the restricted likelihood is largest at the sample variance less that of the errors
    values = np.array([1.0, 3.0, -2.0, 4.0, 0.5])
    found = heterogeneity(values, 0.25 * np.eye(5))
    assert found.width**2 == pytest.approx(np.var(values, ddof=1) - 0.25, rel=1e-3)
    assert found.chi2 == pytest.approx(4 * np.var(values, ddof=1) / 0.25)
    assert found.dof == 4


def test_values_that_agree_have_no_width():
    found = heterogeneity(np.array([1.0, 1.1, 0.9]), np.eye(3))
    assert found.width == 0
    assert found.p > 0.9


def test_two_kinds_have_widths_of_their_own():
    rng = np.random.default_rng(3)
    first, second = np.eye(400, 200), np.eye(400, 200, k=-200)
    z = rng.standard_normal(400) + first @ (5 * rng.standard_normal(200))
    z += second @ (0.8 * rng.standard_normal(200))
    found = estimate_widths(z, [first, second])
    assert found.widths == pytest.approx((5.0, 0.8), rel=0.2)
    assert found.log_likelihood > 100
