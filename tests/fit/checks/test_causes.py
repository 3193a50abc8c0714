"""Faults of a whole run put into telemetry of the synthetic oracle are named, and no others are."""

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
    """Return kinds and words where channels of another experiment are functions of all of them."""
    experiments, joint, (sysid, noise) = campaign()
    old = sysid.channels
    new = {name: np.asarray(function(old), dtype=float) for name, function in channels.items()}
    faulty = [replace(sysid, channels=old | new), noise]
    (e,) = paired([replace(run, **(labels or {})) for run in faulty])
    sharing, names = Sharing(settings().shared), [p.name for p in joint.parameters]
    maps = {
        epoch: sharing.matrix(replace(e.sysid.telemetry, alignment_epoch=epoch), e.parameters, names)
        for epoch in (1, 2)
    }
    own = maps.pop(e.sysid.telemetry.alignment_epoch)
    (block,) = fit_experiment(e).whitened_runs
    block = replace(block, parameter_map=own)
    score = run_score(e.name, block, run_estimate(e.name, block), joint.solution.theta)
    test = consistency_test(experiments, joint)
    return [(c.code, c.message) for c in likely_causes(replace(test, runs=(*test.runs, score)), maps)]


def late(x, samples):
    n = np.arange(x.size)
    return interpolate.CubicSpline(n, x)(np.clip(n - samples, 0, n[-1]))


def test_run_that_agrees_has_no_cause():
    assert causes() == []


NAMED = {
    "scale": ({"f_x_2": lambda c: 1.02 * c["f_x_2"]}, "f_x_2 is 1.0"),
    "unit": ({"f_x_2": lambda c: 1.928 * c["f_x_2"]}, "f_x_2 is in N and not in m s-2"),
    "sign": ({"f_x_1": lambda c: -c["f_x_1"]}, "f_x_1 has the wrong sign"),
    "lag": ({"f_x_2": lambda c: late(c["f_x_2"], 1)}, "f_x_2 is late by "),
    "commands exchanged": (
        {"f_x_1": lambda c: c["f_x_2"], "f_x_2": lambda c: c["f_x_1"]},
        "f_x_1 and f_x_2 are exchanged",
    ),
    "epoch": ({"labels": {"alignment_epoch": 2}}, "its alignment epoch is 1"),
    "authority": ({"labels": {"F_max_2": 2.2e-9}}, "omega2_2 differs by 3.5"),
}


@pytest.mark.parametrize("name", NAMED)
def test_fault_of_the_whole_run_is_named(name):
    faults, words = NAMED[name]
    named = causes(**faults)
    assert any(words in clause for _, clause in named), named
    assert len(named) <= 2
