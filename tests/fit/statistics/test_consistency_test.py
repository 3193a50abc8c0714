"""T and what falls away from it, compared with least squares by NumPy on runs drawn at random."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from fit.fitting.experiment_and_joint_fit import fit_joint
from fit.settings import settings
from fit.statistics.consistency_test import ChiSquare, ConsistencyTest, consistency_test
from fit.whitening import pair
from tests.fit.statistics.runs import SCALE, K, P, consistency
from tests.oracles import synthetic
from tests.oracles.synthetic import World

RUNS = 5


def least_squares_of(X, z):
    return float(np.sum((z - X @ np.linalg.lstsq(X, z)[0]) ** 2))


def test_sums_of_squares_are_those_of_least_squares():
    test = consistency(1, RUNS)
    X, z = test.jacobian, test.residual
    assert test.total.value == pytest.approx(least_squares_of(X, z))
    assert test.total.dof == RUNS * K - P
    rest = np.arange(z.size) >= K
    assert test.of_runs([0]).value == pytest.approx(
        least_squares_of(X, z) - least_squares_of(X[rest], z[rest])
    )
    assert test.of_runs([0]).dof == K
    assert test.without([0]).total.value == pytest.approx(least_squares_of(X[rest], z[rest]))


def test_sums_over_subsets_are_those_of_the_runs_in_them():
    test = consistency(1, RUNS)
    subsets = np.array([[1, 1, 1, 1, 1], [0, 1, 1, 0, 1]], dtype=bool)
    values, dofs = test.chi2_of_subsets(subsets)
    for value, dof, expected in zip(values, dofs, (test.total, test.without([0, 3]).total), strict=True):
        assert value == pytest.approx(expected.value)
        assert dof == expected.dof


def test_offset_of_a_coefficient_is_measured():
    test = consistency(2, RUNS, bad=(3,))
    run = test.runs[3]
    assert max(range(RUNS), key=lambda i: test.of_runs([i]).value) == 3
    value, sigmas = run.single_fit()
    assert abs(value[1] - 50 / SCALE[1]) < 4.5 * sigmas[1]


@pytest.mark.stat  # fails once in 10,000
def test_p_values_are_even():
    tests = [consistency(seed, RUNS) for seed in range(1000, 1300)]
    for values in ([test.total.p for test in tests], [test.of_runs([1]).p for test in tests]):
        assert kstest(values, "uniform").pvalue > 5e-5


def test_noise_model_of_few_degrees_of_freedom_is_uncertain():
    assert ChiSquare(30.0, 5).p == pytest.approx(chi2.sf(30, 5))
    assert ChiSquare(30.0, 5, 20.0).p > 50 * ChiSquare(30.0, 5).p
    # the mean over the errors of the model is its degrees of freedom
    rng = np.random.default_rng(4)
    sums = rng.chisquare(5, 20000) / (rng.chisquare(20, 20000) / 20) * 18 / 20
    assert sums.mean() == pytest.approx(5, rel=0.02)
    assert np.mean([ChiSquare(s, 5, 20.0).p < 0.05 for s in sums[:4000]]) == pytest.approx(0.05, abs=0.014)


def test_errors_of_the_noise_models_add_up_over_runs():
    rng, runs = np.random.default_rng(5), []
    for run in consistency(1, RUNS).runs:
        knots, root = rng.standard_normal((3, K, K)), 0.1 * rng.standard_normal((3, 3))
        effects = knots + knots.swapaxes(1, 2)
        runs.append(replace(run, knot_effects=effects, knot_covariance=root @ root.T))
    test = ConsistencyTest(tuple(runs), np.ones(P), np.zeros((0, P)), np.zeros(0))
    variance = 0.0
    for run, rows in zip(runs, test.rows, strict=True):
        scaled = np.einsum("sij,ij->s", run.knot_effects, test.residual_maker[rows, rows])
        variance += scaled @ run.knot_covariance @ scaled
    assert test.total.noise_dof == pytest.approx(2 * test.total.dof**2 / variance + 4)


def test_run_with_a_tone_has_one_trusted_row_less():
    runs = [run for authority in "ABC" for run in synthetic.pair(World(), authority)]
    runs += synthetic.pair(World(), "D", tones_12=(3.333e-3,), tones_1=())
    experiments = pair(runs)
    *two_tone_runs, tone = consistency_test(experiments, fit_joint(experiments, settings())).runs
    assert {run.residual.size for run in two_tone_runs} == {tone.residual.size + 1}
    # at the tone nothing changes if the gain follows the stiffness
    stiffness, gain = (
        dict(zip(tone.equation.names, tone.run_theta, strict=True))[name] for name in ("omega2_2", "lambda_2")
    )
    follows = gain / (stiffness - (2 * np.pi * 3.333e-3) ** 2)
    along = tone.derivative("omega2_2") + follows * tone.derivative("lambda_2")
    assert np.linalg.norm(along) < 1e-2 * np.linalg.norm(tone.derivative("omega2_2"))
