"""What the data of a joint fit ask to depart: found where it is, and nothing where it is not."""

from dataclasses import replace

import numpy as np
import pytest

from fit.consistency import fit_consistent_runs
from fit.fitting.joint_fit import fit_experiment, fit_joint
from fit.settings import settings
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.oracles.synthetic import World, pair

SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2), ("B", 2), ("A", 2))
PLAIN = settings({"scatter": []})


def experiments(factor=lambda n: 1.0, worlds=None, **options):
    """Make six experiments; `factor` is what the gain of f_x_2 is multiplied by in the n-th of them."""
    found = []
    for n, (authority, epoch) in enumerate(SETS):
        world = worlds[n] if worlds else World()
        runs = pair(world, authority, epoch=epoch, experiment=f"{authority}{n}", seed=n, **options)
        for i, run in enumerate(runs):
            force = run.channels["f_x_2"]
            runs[i] = replace(run, channels={**run.channels, "f_x_2": force / factor(n)})
        found.append(Experiment(*map(Run, runs)))
    return found


def pulls(outcome, truth):
    found = zip(
        outcome.parameters, outcome.solution.theta, outcome.solution.sigma, outcome.undetermined, strict=True
    )
    return {p.name: (x - truth[p.name]) / s for p, x, s, lost in found if p.equation and not lost}


def consistent(runs):
    """Return the joint fit of the runs that agree, and which are left out."""
    fit = fit_consistent_runs(runs, {e.name: fit_experiment(e) for e in runs}, settings(), {})
    return fit.outcome, [exclusion.experiment for exclusion in fit.left_out]


@pytest.fixture(scope="module")
def clean():
    return fit_joint(experiments(), PLAIN)


def test_on_clean_data_nothing_departs(clean):
    auto, _ = consistent(experiments())
    assert auto.scatter == {}
    move = (auto.solution.theta - clean.solution.theta) / clean.solution.sigma
    assert np.abs(move[~clean.undetermined]).max() < 2e-3
    assert auto.solution.sigma == pytest.approx(clean.solution.sigma, rel=1e-4)


def test_gains_that_scatter_are_let_scatter():
    rng = np.random.default_rng(2)
    gains = 1 + 0.003 * rng.standard_normal(len(SETS))
    late = [World(lambda_2=1.0776 * g, C_2=0.186 * g) for g in gains]  # as late as ever
    found, left_out = consistent(experiments(worlds=late))
    assert found.data_driven
    assert not left_out
    assert set(found.scatter) == {"lambda_1", "lambda_2"}
    value, sigma = found.scatter["lambda_2"]
    assert abs(value - 1.0776 * np.std(gains, ddof=1)) < 2 * sigma
    assert max(abs(p) for p in pulls(found, vars(World())).values()) < 4.5
    # the departures that were estimated are those that were made
    at = [p.name for p in found.parameters].index("dlambda_2_A0")
    departures = found.solution.theta[at : at + len(SETS)]
    assert departures - departures.mean() == pytest.approx(1.0776 * (gains - gains.mean()), abs=1e-4)
    assert found.solution.chi2 / found.solution.dof == pytest.approx(1, abs=0.05)


def test_gain_of_one_run_is_no_scatter():
    found, left_out = consistent(experiments(lambda n: 1.01 if n == 2 else 1.0))
    assert found.scatter == {}
    assert left_out == ["C2"]


def test_what_is_no_gain_is_not_taken_for_one():
    # the stiffness of two epochs differs: gains that scatter would explain a part of it
    worlds = [World(omega2_2_0=-4.19e-7 * (1.4 if epoch == 2 else 1.0)) for _, epoch in SETS]
    assert consistent(experiments(worlds=worlds))[0].scatter == {}


def test_both_gains_share_a_width():
    chosen = settings({"scatter": ["lambda_1", "lambda_2"]})
    gains = 1 + 0.003 * np.array([1.0, -0.7, 0.4, -1.1, 0.6, -0.3])
    runs = experiments(worlds=[World(lambda_2=1.0776 * g) for g in gains], drive_1=1e-12)
    found = fit_joint(runs, chosen)
    one, two = found.scatter["lambda_1"], found.scatter["lambda_2"]
    assert one[0] / two[0] == pytest.approx(1.0748 / 1.0776)
