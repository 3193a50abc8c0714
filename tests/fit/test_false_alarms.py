"""The budget of false alarms is spent once, whatever the number of families and tests."""

import numpy as np
import pytest

from fit import false_alarms


def test_all_families_together_spend_the_budget():
    spent = sum(7 * false_alarms.p_limit(family, 7) for family in false_alarms.FAMILIES)
    assert spent == pytest.approx(false_alarms.BUDGET)


@pytest.mark.stat  # 2e5 draws; the tolerance is five standard errors, false positives below 1e-6
def test_limits_are_those_of_gaussian_noise(monkeypatch):
    monkeypatch.setattr(false_alarms, "BUDGET", 0.06 * len(false_alarms.FAMILIES))
    z = np.random.default_rng(1).standard_normal((200_000, 3))
    error = 5 * np.sqrt(0.06 / 200_000)
    assert np.mean(np.abs(z[:, 0]) > false_alarms.sigma_limit("model")) == pytest.approx(0.06, abs=error)
    assert np.mean(np.sum(z**2, 1) > false_alarms.chi2_limit("model", 3)) == pytest.approx(0.06, abs=error)


def test_an_unknown_family_has_no_budget():
    with pytest.raises(KeyError):
        false_alarms.p_limit("luck")
