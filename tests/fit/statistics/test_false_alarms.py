"""The budget of false alarms is spent once, however often the tests are applied."""

import numpy as np
import pytest

from fit import false_alarms
from fit.checks import CHECKS

OTHERS = 5  # Euler force, subtraction, couplings that drift, constraints, loop


def test_all_tests_together_spend_the_budget():
    assert sum(check.n_tests for check in CHECKS) + OTHERS <= false_alarms.N_TESTS
    assert false_alarms.N_TESTS * 7 * false_alarms.p_limit(7) == pytest.approx(false_alarms.BUDGET)


@pytest.mark.stat  # 2e5 draws; the tolerance is five standard errors, false positives below 1e-6
def test_limits_are_those_of_gaussian_noise(monkeypatch):
    monkeypatch.setattr(false_alarms, "BUDGET", 0.06 * false_alarms.N_TESTS)
    z = np.random.default_rng(1).standard_normal((200_000, 3))
    error = 5 * np.sqrt(0.06 / 200_000)
    assert np.mean(np.abs(z[:, 0]) > false_alarms.sigma_limit()) == pytest.approx(0.06, abs=error)
    assert np.mean(np.sum(z**2, 1) > false_alarms.chi2_limit(3)) == pytest.approx(0.06, abs=error)
