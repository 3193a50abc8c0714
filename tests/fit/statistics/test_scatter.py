"""Scatter of gains between runs: seen where it is simulated, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from fit.agreement import fit_consistent_runs
from fit.fitting import fit_experiment, fit_joint
from fit.settings import settings
from fit.whitening import Experiment, Run
from tests.oracles.synthetic import World, pair

SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2), ("B", 2), ("A", 2))
PLAIN = settings({"scatter": []})


def experiments(factor=lambda n: 1.0, worlds=None, **options):
    """Make six experiments; `factor` is what the gain of f_x_2 is multiplied by in the n-th of them."""
    campaign = []
    for n, (authority, epoch) in enumerate(SETS):
        world = worlds[n] if worlds else World()
        runs = pair(world, authority, epoch=epoch, experiment=f"{authority}{n}", seed=n, **options)
        for i, run in enumerate(runs):
            force = run.channels["f_x_2"]
            runs[i] = replace(run, channels={**run.channels, "f_x_2": force / factor(n)})
        campaign.append(Experiment(*map(Run, runs)))
    return campaign


def pulls(outcome, truth):
    estimates = zip(outcome.parameters, outcome.solution.theta, outcome.solution.sigma, strict=True)
    determined = ~outcome.undetermined
    return {
        p.name: (x - truth[p.name]) / s
        for (p, x, s), is_determined in zip(estimates, determined, strict=True)
        if p.equation > 0 and is_determined
    }


def consistent(runs):
    """Return the joint fit of the runs that agree, and which are left out."""
    fit = fit_consistent_runs(runs, {e.name: fit_experiment(e) for e in runs}, settings())
    return fit.outcome, [e.name for e in fit.outliers]


@pytest.fixture(scope="module")
def clean():
    return fit_joint(experiments(), PLAIN)


def test_nothing_scatters_in_clean_data(clean):
    auto, _ = consistent(experiments())
    assert auto.scatter == {}
    move = (auto.solution.theta - clean.solution.theta) / clean.solution.sigma
    assert np.abs(move[~clean.undetermined]).max() < 2e-3
    assert auto.solution.sigma == pytest.approx(clean.solution.sigma, rel=1e-4)


def test_scatter_of_gains():
    rng = np.random.default_rng(2)
    gains = 1 + 0.003 * rng.standard_normal(len(SETS))
    late = [World(lambda_2=1.0776 * g, C_2=0.186 * g) for g in gains]  # as late as ever
    joint, left_out = consistent(experiments(worlds=late))
    assert joint.data_driven
    assert not left_out
    assert set(joint.scatter) == {"lambda_1", "lambda_2", "C_1", "C_2"}
    value, sigma = joint.scatter["lambda_2"]
    assert abs(value - 1.0776 * np.std(gains, ddof=1)) < 2 * sigma
    assert max(abs(p) for p in pulls(joint, vars(World())).values()) < 4.5
    # the deviations that were estimated are those that were drawn
    start = [p.name for p in joint.parameters].index("dlambda_2_A0")
    deviations = joint.solution.theta[start : start + len(SETS)]
    assert deviations - deviations.mean() == pytest.approx(1.0776 * (gains - gains.mean()), abs=1e-4)
    assert joint.solution.chi2 / joint.solution.dof == pytest.approx(1, abs=0.05)


def test_different_stiffness_is_no_scatter_of_gains():
    # the stiffness of two epochs differs: gains that scatter would explain a part of it
    worlds = [World(omega2_2_0=-4.19e-7 * (1.4 if epoch == 2 else 1.0)) for _, epoch in SETS]
    assert consistent(experiments(worlds=worlds))[0].scatter == {}
