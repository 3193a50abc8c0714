"""Cross-talk that drifts between the experiments of an epoch: found, and held by the sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from fit.crosstalk import attenuation, crosstalk_fit
from fit.fitting import drift
from fit.fitting.joint_fit import fit_joint
from fit.model.sharing import Sharing
from fit.settings import settings
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.oracles.bump_synthetic import TRUTH, Motion, pair
from tests.oracles.synthetic import World

LATE = World(plateau=2e-15, tail=8e-15)
CLEAN = Motion(grs=0.0, dws=0.0)


def told(by):
    """Return the cross-talk of three experiments whose b_1 differ."""
    b = [TRUTH["b_1"] + x for x in by]
    runs = [
        Experiment(*map(Run, pair(replace(CLEAN, b=TRUTH | {"b_1": own}), LATE, authority)))
        for own, authority in zip(b, "ABC", strict=True)
    ]
    outcome = fit_joint(runs, settings({"scatter": []}))
    free = attenuation.correct_attenuation(outcome, runs)
    return crosstalk_fit.cross_talk(outcome, runs, Sharing(settings().shared), free)["1"], float(np.mean(b))


def test_the_sigma_holds_what_experiments_differ_by():
    steady, _ = told([0.0, 0.0, 0.0])
    assert "cross_talk_drift" not in [w.code for w in steady.warnings]
    sigma = steady.parameters["b_1"].sigma
    by = 30 * sigma
    found, mean = told([-by, 0.0, by])
    (warning,) = (w for w in found.warnings if w.code == "cross_talk_drift")
    assert warning.parameters == ("b_1",)
    e = found.parameters["b_1"]
    assert e.sigma == pytest.approx(by / np.sqrt(3), rel=0.15)
    assert abs(e.value - mean) < e.sigma
    assert found.covariance[0, 0] == pytest.approx(e.sigma**2)
    for name in ("b_2", "b_3"):
        assert found.parameters[name].sigma == pytest.approx(steady.parameters[name].sigma, rel=0.1)


def test_the_width_beyond_noise_is_that_put_in():
    # the variance of 6 values has a relative error of 0.63: 5 sigma of its mean over 400 draws is 16 %
    rng = np.random.default_rng(0)
    noise = np.diag([1.0, 1.0, 4.0, 1.0, 0.25, 1.0])
    variances = []
    for _ in range(400):
        values = 10 * rng.standard_normal(6) + np.sqrt(np.diag(noise)) * rng.standard_normal(6)
        found = drift.estimate_drift(values, noise)
        variances.append(found.width**2 if found else 0.0)
        if found:  # of values that differ by far more than noise, weighed by noise
            w = 1 / np.diag(noise) / np.sum(1 / np.diag(noise))
            assert found.variance == pytest.approx(found.width**2 * (w @ w))
    assert np.mean(variances) == pytest.approx(100, abs=16)


def test_noise_is_no_drift():
    # one of 12,000 by definition; two or more of 1000 once in 300
    rng = np.random.default_rng(1)
    covariance = 0.5 + np.diag([1.0, 2.0, 3.0, 1.0])
    drawn = rng.multivariate_normal(np.zeros(4), covariance, size=1000)
    assert sum(drift.estimate_drift(values, covariance) is not None for values in drawn) < 2
