"""What changes in the course of all runs alike makes no run contradict another, and is told all the same."""

import re
from functools import cache

import numpy as np
import pytest

from fit.estimate import fit_joint
from fit.judgement.lasting import changing, drifts
from fit.pipeline import calibrate
from fit.settings import settings
from fit.weighing import pair
from tests.oracles import thirteen

NAMES = ("A2", "B4", "C4", "D4")
DURATION = 21600.0  # s
DRIFT = 2e-7  # s-2, from start to end


def softening(time, channels):
    """What a stiffness of test mass 2 that grows along the run adds, beyond that of mid-run."""
    x_2 = channels["o_1"] + channels["o_12"]
    nothing = np.zeros(time.size)
    return nothing, nothing, -DRIFT * np.clip(time / DURATION - 0.5, -0.5, 0.5) * x_2


@cache
def runs(hidden=None):
    return [
        thirteen.telemetry(thirteen.made(name, kind, seed=3), hidden=hidden if kind == "sysid" else None)
        for name in NAMES
        for kind in ("noise", "sysid")
    ]


def test_stiffness_that_drifts_in_all_runs_alike_is_told():
    joint = calibrate(runs(softening)).joint
    assert [w.code for w in joint.unsound] == ["changing"]
    assert re.match(r"omega2_2 changes by (1\.[6-9]|2\.[0-4]|2)e-07 ", joint.unsound[0].message)
    off = joint.parameters["omega2_1_0"]
    assert abs(off.value - thirteen.TRUTH["omega2_1_0"]) > 10 * off.sigma  # it passes for another stiffness


@pytest.mark.parametrize(("hidden", "drift"), [(None, 0.0), (softening, DRIFT)])
def test_amounts_and_sigmas_are_right(hidden, drift):
    experiments = pair(runs(hidden))
    outcome = fit_joint(experiments, settings())
    found = drifts(experiments, outcome)
    amount, sigma = found["omega2_2"]
    assert abs(amount - drift) < 4 * sigma
    assert 5e-9 < sigma < 3e-8
    if not drift:
        assert all(abs(value) < 4 * of_it for value, of_it in found.values())
        assert changing(experiments, outcome) == []
