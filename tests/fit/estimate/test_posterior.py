"""The density that is sampled, written out once more."""

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import FitError
from fit.fitting.joint_fit import fit_joint
from fit.fitting.normal import inflation
from fit.sampling.posterior import Posterior
from fit.settings import settings
from fit.whitening.run import Run
from fit.whitening.runs import Experiment
from tests.oracles.synthetic import World, pair

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def experiments():
    return [Experiment(*map(Run, pair(World(), authority))) for authority in "ABC"]


@pytest.fixture(scope="module")
def fitted(experiments):
    return fit_joint(experiments, settings())


def test_density_is_chi2_of_the_columns(linear_case):
    outcome, mean, covariance = linear_case
    posterior = Posterior(outcome)
    z = np.random.default_rng(1).standard_normal((5, 3))
    theta = outcome.solution.theta + z @ np.linalg.cholesky(outcome.solution.covariance).T
    assert posterior.theta(z) == pytest.approx(theta)
    away = theta - mean
    expected = -np.einsum("wi,ij,wj->w", away, np.linalg.inv(covariance), away) / 2
    assert np.diff(posterior(z)) == pytest.approx(np.diff(expected), rel=1e-6, abs=1e-6)


def test_inflation_is_the_window(fitted):
    # Tukey 0.1: 1 / mean(w^2) for what lies in its flat part, mean(w^4) / mean(w^2)^2 for what lasts all day
    flat = 1 / (1 - 0.1 * 5 / 8)
    throughout = (1 - 0.1 * 93 / 128) * flat**2
    for block in fitted.blocks:
        assert throughout - 0.01 < inflation(block, fitted.solution.theta) < flat + 0.01
        bare = replace(block, window=None)
        assert inflation(bare, fitted.solution.theta) == pytest.approx(1)


def test_curvature_is_that_of_the_true_sigmas(fitted):
    posterior, h = Posterior(fitted), 0.1
    P = len(posterior.names)
    steps = h * np.eye(P)
    at = posterior(np.concatenate([np.zeros((1, P)), steps, -steps]))
    curvature = (at[1 : P + 1] + at[P + 1 :] - 2 * at[0]) / h**2
    assert curvature == pytest.approx(-np.ones(P), abs=0.02)
    assert at[1 : P + 1] == pytest.approx(at[P + 1 :], abs=0.01 * h)  # it is flat where least squares ends


def test_covariance_that_is_none(linear_case):
    outcome = linear_case[0]
    solution = replace(outcome.solution, covariance=-outcome.solution.covariance)
    with pytest.raises(FitError, match="not positive"):
        Posterior(replace(outcome, solution=solution))


def told(block, c):
    """Return minus the logarithm of the likelihood of a run, written out."""
    u = np.abs(block.columns @ c) ** 2
    if block.weights.likelihood == "student_t":
        return 3.5 * np.sum(np.log(1 + u / 5))
    return sum((b.stop - b.start) * np.log(np.sum(u[b])) for b in block.weights.bands)


@pytest.mark.parametrize("estimator", ["student_t", "marginalised"])
def test_other_likelihoods_are_themselves(experiments, estimator):
    outcome = fit_joint(experiments, settings({"estimator": estimator}))
    posterior = Posterior(outcome)
    P, h = len(posterior.names), 0.5
    z = np.concatenate([np.zeros((1, P)), np.random.default_rng(0).standard_normal((4, P))])
    theta = posterior.theta(z)
    expected = [
        -sum(told(b, b.coefficients(t)) / k for b, k in zip(outcome.blocks, posterior.inflation, strict=True))
        - np.sum((outcome.prior.rows @ (t - outcome.prior.centre)) ** 2) / 2
        for t in theta
    ]
    assert np.diff(posterior(z)) == pytest.approx(np.diff(expected), abs=1e-6)
    # it peaks where the fit ended, about as sharply as its sigmas say: a tone lies in few bins, and the
    # curvature of a Student-t is that of these very bins
    at = posterior(np.concatenate([np.zeros((1, P)), h * np.eye(P), -h * np.eye(P)]))
    curvature = (at[1 : P + 1] + at[P + 1 :] - 2 * at[0]) / h**2
    assert np.mean(curvature) == pytest.approx(-1, abs=0.15)  # the sigmas are those of the expected one
    assert curvature == pytest.approx(-np.ones(P), abs=0.4)
    slope = (posterior(0.01 * np.eye(P)) - posterior(-0.01 * np.eye(P))) / 0.02
    assert slope == pytest.approx(np.zeros(P), abs=0.02)


def of_gaussian(block, points):
    return -np.sum((block.R @ block.coefficients(points)) ** 2, axis=0) / 2


def of_levels(block, points):
    power = np.abs(block.columns @ block.coefficients(points)) ** 2
    return -sum((b.stop - b.start) * np.log(power[b].sum(axis=0)) for b in block.weights.bands)


def of_student(block, points):
    power = np.abs(block.columns @ block.coefficients(points)) ** 2
    return -3.5 * np.log1p(power / 5).sum(axis=0)


@pytest.mark.parametrize(
    ("estimator", "likelihood", "within"),  # two integrals are not quite normal
    [("gaussian", of_gaussian, 1e-4), ("marginalised", of_levels, 0.03), ("student_t", of_student, 0.1)],
)
def test_departures_are_integrated_over(experiments, estimator, likelihood, within):
    outcome = fit_joint(experiments, settings({"scatter": ["lambda_2"], "estimator": estimator}))
    posterior = Posterior(outcome)
    assert posterior.names[-1] == "log_width_gain"
    z = np.random.default_rng(1).standard_normal((3, len(posterior.names)))
    sampled = posterior.theta(z)
    sampled[:, -1] = np.log(3e-3)  # of sigmas of a run, hundreds
    sampled[:, 1] += (0.0, 3e-3, -3e-3)  # lambda_2
    (width,) = outcome.departing
    found = []
    for t in sampled:
        spread = np.exp(t[-1]) * width.units
        total = (
            width.log_prior(t[-1])
            - np.sum(
                (outcome.prior.rows[:, : outcome.shared] @ (t[:-1] - outcome.prior.centre[: outcome.shared]))
                ** 2
            )
            / 2
        )
        theta = np.concatenate([t[:-1], np.zeros(len(spread))])
        for block, k, s, i in zip(outcome.blocks, posterior.inflation, spread, width.members, strict=True):
            # a sum over departures in place of the integral
            at = outcome.solution.theta[1] + outcome.solution.theta[i] - t[1]
            d = at + np.linspace(-1, 1, 2001) * 3e-4
            points = np.repeat(theta[:, None], d.size, axis=1)
            points[i] = d
            log = likelihood(block, points) / k - (d / s) ** 2 / 2
            total += np.log(np.sum(np.exp(log - log.max())) * (d[1] - d[0]) / s) + log.max()
        found.append(total)
    z = np.linalg.solve(posterior.root, (sampled - posterior.centre).T).T
    assert np.diff(posterior(z)) == pytest.approx(np.diff(found), abs=within)
