"""The budget of false alarms is spent once, however often the tests are applied."""

import re

import numpy as np
import pytest

from fit import false_alarms
from tests import ROOT


def test_all_tests_together_spend_the_budget():
    spent = sum(7 * false_alarms.p_limit(test, 7) for test in false_alarms.TESTS)
    assert spent == pytest.approx(false_alarms.BUDGET)


def test_every_test_takes_its_share_in_one_room():
    # a share that two modules take is spent twice; those of one decision may share it
    sources = {path: path.read_text(encoding="utf-8") for path in (ROOT / "fit").rglob("*.py")}
    users = {
        test: [path for path, text in sources.items() if re.search(rf'_limit\(\s*"{test}"', text)]
        for test in false_alarms.TESTS
    }
    for test, paths in users.items():
        assert paths, test
        assert len({path.parent for path in paths}) == 1, test


@pytest.mark.stat  # 2e5 draws; the tolerance is five standard errors, false positives below 1e-6
def test_limits_are_those_of_gaussian_noise(monkeypatch):
    monkeypatch.setattr(false_alarms, "BUDGET", 0.06 * len(false_alarms.TESTS))
    z = np.random.default_rng(1).standard_normal((200_000, 3))
    error = 5 * np.sqrt(0.06 / 200_000)
    assert np.mean(np.abs(z[:, 0]) > false_alarms.sigma_limit("templates")) == pytest.approx(0.06, abs=error)
    assert np.mean(np.sum(z**2, 1) > false_alarms.chi2_limit("templates", 3)) == pytest.approx(
        0.06, abs=error
    )
