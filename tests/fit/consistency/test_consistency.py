"""T and what falls away from it, beside least squares by NumPy on voices drawn at random."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from fit.consistency import consistency
from fit.consistency.consistency import Regression, Squares, Voice
from fit.fitting.joint_fit import fit_joint
from fit.settings import settings
from fit.whitening.runs import pair
from tests.oracles import synthetic
from tests.oracles.synthetic import World

RUNS, K, P = 5, 7, 6


def drawn(rng, moved=None, by=0.0):
    """Return voices of five runs that share six parameters; of one of them a coefficient is moved."""
    voices = []
    for i in range(RUNS):
        answer = rng.standard_normal((K, K + 1))
        share = rng.standard_normal((K, P))
        gradient = np.eye(K + 1, K, k=-1)
        z = rng.standard_normal(K)
        if i == moved:
            z = z - by * answer[:, 3]
        nothing = np.zeros((0, K, K)), np.zeros((0, 0))
        voices.append(Voice(f"run {i}", z, answer, gradient, share, np.zeros(K), (0.0, 0.0), *nothing))
    return Regression(tuple(voices), np.ones(P), np.zeros((0, P)), np.zeros(0))


def least(X, z):
    return float(np.sum((z - X @ np.linalg.lstsq(X, z)[0]) ** 2))


def test_sums_of_squares_are_those_of_least_squares():
    voices = drawn(np.random.default_rng(1))
    X, z = voices.X, voices.z
    assert voices.whole.value == pytest.approx(least(X, z))
    assert voices.whole.dof == RUNS * K - P
    kept = np.arange(z.size) >= K
    assert voices.of_run(0).value == pytest.approx(least(X, z) - least(X[kept], z[kept]))
    assert voices.of_run(0).dof == K
    assert voices.without([0]).whole.value == pytest.approx(least(X[kept], z[kept]))
    column = voices.column(2, voices.voices[2].along("lambda_2"))
    more = np.hstack([X, column])
    assert voices.of_columns(column).value == pytest.approx(least(X, z) - least(more, z))
    amount = -np.linalg.lstsq(more, z)[0][-1]
    assert voices.amount(column)[0] == pytest.approx(amount)


def test_a_moved_coefficient_is_measured():
    voices = drawn(np.random.default_rng(2), moved=3, by=50.0)
    column = voices.column(3, voices.voices[3].answer[:, 3])
    amount, sigma = voices.amount(column)
    assert abs(amount - 50) < 4.5 * sigma
    assert max(range(RUNS), key=lambda i: voices.of_run(i).value) == 3
    alone, of_alone = voices.voices[3].alone()
    assert abs(alone[2] - 50) < 4.5 * of_alone[2]


@pytest.mark.stat  # fails once in 10,000
def test_p_values_are_even():
    rng = np.random.default_rng(3)
    regressions = [drawn(rng) for _ in range(300)]
    for values in ([v.whole.p for v in regressions], [v.of_run(1).p for v in regressions]):
        assert kstest(values, "uniform").pvalue > 5e-5


def test_a_noise_model_of_few_degrees_of_freedom_takes_nothing_for_sure():
    assert Squares(30.0, 5).p == pytest.approx(chi2.sf(30, 5))
    assert Squares(30.0, 5, 20.0).p > 50 * Squares(30.0, 5).p
    # the mean over the errors of the model is its degrees of freedom
    rng = np.random.default_rng(4)
    sums = rng.chisquare(5, 20000) / (rng.chisquare(20, 20000) / 20) * 18 / 20
    assert sums.mean() == pytest.approx(5, rel=0.02)
    assert np.mean([Squares(s, 5, 20.0).p < 0.05 for s in sums[:4000]]) == pytest.approx(0.05, abs=0.014)


def test_errors_of_the_noise_models_add_up_over_runs():
    rng, voices = np.random.default_rng(5), []
    for v in drawn(np.random.default_rng(1)).voices:
        knots, root = rng.standard_normal((3, K, K)), 0.1 * rng.standard_normal((3, 3))
        voices.append(replace(v, knots=knots + knots.swapaxes(1, 2), of_knots=root @ root.T))
    regression = Regression(tuple(voices), np.ones(P), np.zeros((0, P)), np.zeros(0))
    variance = 0.0
    for v, rows in zip(voices, regression.rows, strict=True):
        louder = np.einsum("sij,ij->s", v.knots, regression.residual_maker[rows, rows])
        variance += louder @ v.of_knots @ louder
    whole = regression.whole
    assert whole.of_noise == pytest.approx(2 * whole.dof**2 / variance + 4)


def test_gain_against_stiffness_of_a_tone_is_heard_where_it_moves_the_joint_fit():
    runs = [run for authority in "ABC" for run in synthetic.pair(World(), authority)]
    runs += synthetic.pair(World(), "D", tones_12=(3.333e-3,), tones_1=())
    experiments = pair(runs)
    outcome = fit_joint(experiments, settings())
    covariance = outcome.solution.covariance
    *_, tone = zip(experiments, outcome.blocks, strict=True)
    agreeing = consistency.voice(*tone, outcome.solution.theta, covariance)
    theta = outcome.solution.theta.copy()
    theta[[p.name for p in outcome.parameters].index("omega2_2_0")] += 1e-5  # s-2
    light, leant_on, only = (consistency.voice(*tone, theta, covariance * by) for by in (1e-4, 1, 100))
    alone = consistency.voice(*tone, theta)
    for other in (agreeing, alone, light, only):
        assert len(other.z) == len(leant_on.z) - 1
    # at the tone nothing changes if the gain follows the stiffness; the rest of the run tells
    stiffness, gain = (
        dict(zip(light.names, light.theta, strict=True))[name] for name in ("omega2_2", "lambda_2")
    )
    follows = gain / (stiffness - (2 * np.pi * tone[1].tone) ** 2)
    for voice, told in ((light, False), (leant_on, True)):
        along = voice.along("omega2_2") + follows * voice.along("lambda_2")
        assert (np.linalg.norm(along) > 1e-3 * np.linalg.norm(voice.along("omega2_2"))) == told


@pytest.mark.slow
@pytest.mark.stat  # fails once in 5,000
def test_runs_of_one_world_agree():
    total = dof = 0.0
    for seed in range(10):
        runs = [
            run
            for authority in "ABCDE"
            for run in synthetic.pair(World(), authority, seed=seed, drive_1=1e-12 * (authority == "E"))
        ]
        experiments = pair(runs)
        whole = consistency.regression(experiments, fit_joint(experiments, settings())).whole
        assert whole.dof == 16
        total, dof = total + whole.value, dof + whole.dof
    assert 1e-4 < chi2.sf(total, dof) < 1 - 1e-4
