"""Faults of a whole run put into telemetry of the synthetic oracle are named, and no others are."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import interpolate

from fit.checks.causes import likely_causes
from fit.fitting import fit_experiment, fit_joint, run_estimate
from fit.model import Sharing
from fit.settings import settings
from fit.statistics.consistency_test import consistency_test
from fit.statistics.run_scores import run_score
from fit.whitening import pair as paired
from tests.oracles.synthetic import World, pair

N = 21600


@cache
def campaign():
    """Return the runs of three experiments, their joint fit, and the runs of another one."""
    other_epoch = World(delta_ifo_2=4e-5)
    runs = [
        *pair(World(), "A", seed=1),
        *pair(World(), "E", seed=2, drive_1=1e-12),
        *pair(other_epoch, "C", epoch=2, seed=4),
    ]
    experiments = paired(runs)
    return experiments, fit_joint(experiments, settings()), pair(World(), "B", seed=3, drive_1=5e-13)


def causes(labels=None, **channels):
    """Return words where channels of another experiment are functions of all of them."""
    experiments, joint, (sysid, noise) = campaign()
    old = sysid.channels
    new = {name: np.asarray(function(old), dtype=float) for name, function in channels.items()}
    faulty = [replace(sysid, channels=old | new), noise]
    (e,) = paired([replace(run, **(labels or {})) for run in faulty])
    share = Sharing(settings().shared).matrix(
        e.sysid.telemetry, e.parameters, [p.name for p in joint.parameters]
    )
    block = replace(fit_experiment(e).whitened_runs[0], parameter_map=share)
    score = run_score(e.name, block, run_estimate(e.name, block), joint.solution.theta)
    test = consistency_test(experiments, joint)
    return [c.message for c in likely_causes(replace(test, runs=(*test.runs, score)))]


def late(x, samples):
    n = np.arange(x.size)
    return interpolate.CubicSpline(n, x)(np.clip(n - samples, 0, n[-1]))


def test_run_that_agrees_has_no_cause():
    assert causes() == []


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ({"f_x_2": lambda c: 1.02 * c["f_x_2"]}, "f_x_2 is 1.0[12]"),
        ({"f_x_1": lambda c: -c["f_x_1"]}, "f_x_1 is -(1.0|0.99)"),
        ({"o_12": lambda c: 1.02 * c["o_12"]}, "o_12 is 1.0[12]"),
        ({"f_x_2": lambda c: late(c["f_x_2"], 1)}, "f_x_2 is late by [01]"),
        ({"labels": {"alignment_epoch": 2}}, "delta_ifo differs by -"),
        ({"labels": {"F_max_2": 2.2e-9}}, "omega2_2 differs by 3.5"),
    ],
)
def test_fault_of_the_whole_run_is_named(faults, words):
    named = causes(**faults)
    assert any(re.match(words, message) for message in named), named
    assert len(named) <= 3
