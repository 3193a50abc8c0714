"""The density that is sampled, written out once more."""

from dataclasses import replace

import numpy as np
import pytest

from fit.errors import FitError
from fit.fitting.experiment_and_joint_fit import fit_joint
from fit.fitting.joint_model import JointModel
from fit.fitting.run_estimate import variance_factor, variance_factors
from fit.parameters import FLIGHT
from fit.sampling.posterior import Posterior
from fit.settings import settings
from fit.whitening import Experiment
from fit.whitening.run import Run
from tests.oracles.synthetic import World, pair

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def experiments():
    return [Experiment(*map(Run, pair(World(), authority))) for authority in "ABC"]


@pytest.fixture(scope="module")
def fitted(experiments):
    return fit_joint(experiments, settings())


def likelihood_alone(outcome):
    """The fit as if its PSDs had no error, so that the density at a point is the likelihood there."""
    model = JointModel([replace(run, psd_covariance=None) for run in outcome.model.runs])
    return replace(outcome, model=model)


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
    for block in fitted.whitened_runs:
        assert throughout - 0.01 < variance_factor(block, fitted.solution.theta) < flat + 0.01
        bare = replace(block, window=None)
        assert variance_factor(bare, fitted.solution.theta) == pytest.approx(1)


def test_curvature_is_that_of_the_covariance_of_the_fit(fitted):
    posterior, h = Posterior(fitted), 0.1
    P = len(posterior.names)
    steps = h * np.eye(P)
    log_density = posterior(np.concatenate([np.zeros((1, P)), steps, -steps]))
    curvature = (log_density[1 : P + 1] + log_density[P + 1 :] - 2 * log_density[0]) / h**2
    information = np.linalg.inv(fitted.solution.covariance)  # window and error of the PSD included
    expected = -np.einsum("ij,ik,kj->j", posterior.root, information, posterior.root)
    assert curvature == pytest.approx(expected, abs=1e-3)
    assert expected == pytest.approx(-np.ones(P))
    assert log_density[1 : P + 1] == pytest.approx(
        log_density[P + 1 :], abs=0.01 * h
    )  # it is flat where least squares ends


def test_covariance_that_is_none(linear_case):
    outcome = linear_case[0]
    solution = replace(outcome.solution, covariance=-outcome.solution.covariance)
    with pytest.raises(FitError, match="not positive"):
        Posterior(replace(outcome, solution=solution))


@pytest.mark.parametrize("constraint", [{"vary": False}, {"expr": "lambda_2"}, {"prior": [1.07, 1e-3]}])
def test_the_error_of_the_psd_widens_the_density_beside_constraints(experiments, constraint):
    outcome = fit_joint(experiments, settings({"parameters": {"lambda_1": constraint}}))
    posterior, h = Posterior(outcome), 0.1
    P = len(posterior.names)
    steps = h * np.eye(P)
    log_density = posterior(np.concatenate([np.zeros((1, P)), steps, -steps]))
    curvature = (log_density[1 : P + 1] + log_density[P + 1 :] - 2 * log_density[0]) / h**2
    assert curvature == pytest.approx(-np.ones(P), abs=1e-3)


def cost(block, c):
    """Return minus the logarithm of the likelihood of a run, written out."""
    u = np.abs(block.columns @ c) ** 2
    if block.weights.likelihood == "student_t":
        return 3.5 * np.sum(np.log(1 + u / 5))
    return sum((b.stop - b.start) * np.log(np.sum(u[b])) for b in block.weights.bands)


@pytest.mark.parametrize("estimator", ["student_t", "marginalised"])
def test_other_likelihoods_are_themselves(experiments, estimator):
    outcome = likelihood_alone(fit_joint(experiments, settings({"estimator": estimator})))
    posterior = Posterior(outcome)
    factors = variance_factors(outcome.whitened_runs, outcome.solution.theta)
    P, h = len(posterior.names), 0.5
    z = np.concatenate([np.zeros((1, P)), np.random.default_rng(0).standard_normal((4, P))])
    theta = posterior.theta(z)
    expected = [
        -sum(cost(b, b.coefficients(t)) / k for b, k in zip(outcome.whitened_runs, factors, strict=True))
        - np.sum((outcome.prior.rows @ (t - outcome.prior.centre)) ** 2) / 2
        for t in theta
    ]
    assert np.diff(posterior(z)) == pytest.approx(np.diff(expected), abs=1e-6)
    # it peaks where the fit ended, about as sharply as its sigmas say: a tone lies in few bins, and the
    # curvature of a Student-t is that of these very bins
    log_density = posterior(np.concatenate([np.zeros((1, P)), h * np.eye(P), -h * np.eye(P)]))
    curvature = (log_density[1 : P + 1] + log_density[P + 1 :] - 2 * log_density[0]) / h**2
    assert np.mean(curvature) == pytest.approx(-1, abs=0.15)  # the sigmas are those of the expected one
    assert curvature == pytest.approx(-np.ones(P), abs=0.4)
    slope = (posterior(0.01 * np.eye(P)) - posterior(-0.01 * np.eye(P))) / 0.02
    assert slope == pytest.approx(np.zeros(P), abs=0.02)


def of_gaussian(_, points, run):
    return np.array([-np.sum(run.residual(theta) ** 2) / 2 for theta in points.T])


def of_levels(block, points, _):
    power = np.abs(block.columns @ block.coefficients(points)) ** 2
    return -sum((b.stop - b.start) * np.log(power[b].sum(axis=0)) for b in block.weights.bands)


def of_student(block, points, _):
    power = np.abs(block.columns @ block.coefficients(points)) ** 2
    return -3.5 * np.log1p(power / 5).sum(axis=0)


@pytest.mark.parametrize(
    ("estimator", "likelihood", "tolerance"),  # two integrals are not quite normal
    [("gaussian", of_gaussian, 1e-4), ("marginalised", of_levels, 0.03), ("student_t", of_student, 0.15)],
)
def test_departures_are_integrated_over(experiments, estimator, likelihood, tolerance):
    outcome = fit_joint(experiments, settings({"scatter": ["lambda_2"], "estimator": estimator}))
    outcome = likelihood_alone(outcome)
    posterior = Posterior(outcome)
    factors = variance_factors(outcome.whitened_runs, outcome.solution.theta)
    if estimator == "gaussian":  # the covariance of a compressed run is the true one
        factors = np.ones(len(outcome.whitened_runs))
    runs = outcome.model.runs
    assert posterior.names[-1] == "log_width_gain"
    z = np.random.default_rng(1).standard_normal((3, len(posterior.names)))
    sampled = posterior.theta(z)
    sampled[:, -1] = np.log(3e-3)  # of sigmas of a run, hundreds
    sampled[:, 1] += (0.0, 3e-3, -3e-3)  # lambda_2
    (width,) = outcome.random_effects
    densities = []
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
        for block, run, k, s, i in zip(
            outcome.whitened_runs, runs, factors, spread, width.members, strict=True
        ):
            # a sum over departures in place of the integral
            departure = outcome.solution.theta[1] + outcome.solution.theta[i] - t[1]
            d = departure + np.linspace(-1, 1, 2001) * 3e-4
            points = np.repeat(theta[:, None], d.size, axis=1)
            points[i] = d
            log = likelihood(block, points, run) / k - (d / s) ** 2 / 2
            total += np.log(np.sum(np.exp(log - log.max())) * (d[1] - d[0]) / s) + log.max()
        densities.append(total)
    z = np.linalg.solve(posterior.root, (sampled - posterior.centre).T).T
    assert np.diff(posterior(z)) == pytest.approx(np.diff(densities), abs=tolerance)


# Constraints of the user ---------------------------------------------------------------------------------


def constrained(experiments, **constraints):
    return Posterior(likelihood_alone(fit_joint(experiments, settings({"parameters": constraints}))))


def test_a_fixed_parameter_does_not_move(experiments, fitted):
    value = fitted.solution.theta[1] + fitted.solution.sigma[1]
    posterior = constrained(experiments, lambda_2={"value": value, "vary": False})
    assert "lambda_2" not in posterior.names
    assert "lambda_2" in posterior.parameters
    theta = posterior.theta(posterior.draw(np.random.RandomState(1), 50))
    assert np.all(theta[:, 1] == value)
    assert np.ptp(theta[:, 3]) > 0


@pytest.mark.parametrize("expr", ["0.95 * lambda_2", "sqrt(lambda_2) * exp(C_2 - C_2)"])
def test_a_tied_parameter_follows_its_expression(experiments, fitted, expr):
    posterior, free = constrained(experiments, lambda_1={"expr": expr}), Posterior(likelihood_alone(fitted))
    theta = posterior.theta(posterior.draw(np.random.RandomState(1), 50))
    expected = 0.95 * theta[:, 1] if "95" in expr else np.sqrt(theta[:, 1])
    assert theta[:, 0] == pytest.approx(expected, rel=1e-14)
    # the density is that without the tie at the same points, but for the weak prior of lambda_1
    z = np.linalg.solve(free.root, (theta - free.centre).T).T
    weak = {p.name: p.prior_sigma for p in fitted.parameters}["lambda_1"]
    weak_prior = -(((theta[:, 0] - FLIGHT["lambda_1"].value) / weak) ** 2) / 2
    log_density = posterior(
        np.linalg.solve(posterior.root, (theta[:, free.names.index("lambda_2") :] - posterior.centre[1:]).T).T
    )
    assert fitted.undetermined[0]
    assert np.diff(log_density) == pytest.approx(np.diff(free(z) - weak_prior), rel=0.02, abs=0.05)


def test_the_density_is_zero_beyond_bounds(experiments, fitted):
    value, sigma = fitted.solution.theta[1], fitted.solution.sigma[1]
    low, high = value - 0.1 * sigma, value + 0.3 * sigma
    posterior = constrained(experiments, lambda_2={"min": low, "max": high})
    z = posterior.draw(np.random.RandomState(1), 500)
    theta = posterior.theta(z)
    assert np.all((low <= theta[:, 1]) & (theta[:, 1] <= high))
    assert np.isfinite(posterior(z)).all()
    outside = np.random.default_rng(1).standard_normal((200, z.shape[1])) * 20
    is_outside = np.abs(posterior.theta(outside)[:, 1] - (low + high) / 2) > (high - low) / 2
    assert is_outside.any()
    assert np.array_equal(np.isneginf(posterior(outside)), is_outside)


def test_a_prior_enters(experiments, fitted):
    value, sigma = fitted.solution.theta[1], fitted.solution.sigma[1]
    mean = value + 3 * sigma
    free = Posterior(likelihood_alone(fitted))
    posterior = constrained(experiments, lambda_2={"prior": [mean, sigma]})
    theta = free.theta(np.random.default_rng(1).standard_normal((20, len(free.names))))
    z, free_z = (np.linalg.solve(p.root, (theta - p.centre).T).T for p in (posterior, free))
    expected = free(free_z) - ((theta[:, 1] - mean) / sigma) ** 2 / 2
    assert np.diff(posterior(z)) == pytest.approx(np.diff(expected), rel=1e-3, abs=0.02)
