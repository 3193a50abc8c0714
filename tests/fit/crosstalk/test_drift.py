"""Cross-talk that drifts between the experiments of an epoch: included in the sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from fit.crosstalk import attenuation, crosstalk_fit
from fit.fitting import fit_joint
from fit.model import Sharing
from fit.settings import settings
from fit.whitening import Experiment, Run
from tests.oracles.bump_synthetic import TRUTH, Motion, pair
from tests.oracles.synthetic import World

LATE = World(plateau=2e-15, tail=8e-15)
CLEAN = Motion(grs=0.0, dws=0.0)


def cross_talk(shifts):
    """Return the cross-talk of three experiments whose b_1 differ."""
    b = [TRUTH["b_1"] + x for x in shifts]
    runs = [
        Experiment(*map(Run, pair(replace(CLEAN, b=TRUTH | {"b_1": b_1}), LATE, authority)))
        for b_1, authority in zip(b, "ABC", strict=True)
    ]
    outcome = fit_joint(runs, settings({"scatter": []}))
    correction = attenuation.correct_attenuation(outcome, runs)
    return crosstalk_fit.cross_talk(outcome, runs, Sharing(settings().shared), correction)["1"], float(
        np.mean(b)
    )


def test_the_sigma_holds_what_experiments_differ_by():
    steady, _ = cross_talk([0.0, 0.0, 0.0])
    assert "cross_talk_drift" not in [w.code for w in steady.warnings]
    sigma = steady.parameters["b_1"].sigma
    shift = 30 * sigma
    fit, mean = cross_talk([-shift, 0.0, shift])
    (warning,) = (w for w in fit.warnings if w.code == "cross_talk_drift")
    assert warning.parameters == ("b_1",)
    e = fit.parameters["b_1"]
    assert e.sigma == pytest.approx(shift / np.sqrt(3), rel=0.15)
    assert abs(e.value - mean) < e.sigma
    assert fit.covariance_matrix[0, 0] == pytest.approx(e.sigma**2)
    for name in ("b_2", "b_3"):
        assert fit.parameters[name].sigma == pytest.approx(steady.parameters[name].sigma, rel=0.1)
