"""Scores of compressed runs drawn at random, for tests of what is done with them."""

from dataclasses import dataclass

import numpy as np

from fit.fitting import RunEstimate
from fit.model.dynamics import PARAMETERS
from fit.statistics.consistency_test import ConsistencyTest
from fit.statistics.run_scores import RunScore

K, P = len(PARAMETERS), 6  # coefficients of a run, parameters that runs share
SCALE = np.array([2e4, 2e4, 1e3, 1e3, 1.0, 1.0, 1.0])  # 1 / sigma of the coefficients


@dataclass(frozen=True)
class Linear:
    """The equation of a run whose coefficients are linear in its parameters."""

    parameter_map: np.ndarray
    names: tuple[str, ...] = PARAMETERS

    def coefficients(self, theta):
        return np.concatenate([[1.0], SCALE * (self.parameter_map @ theta)])

    def run_gradient(self, theta):
        return np.eye(K + 1, K, k=-1) * SCALE

    def gradient(self, theta):
        return self.run_gradient(theta) @ self.parameter_map


def shifted(run, offset):
    """Return a run whose coefficients, in units of about their sigma, are off by so much, shape (K,)."""
    estimate = run.estimate
    off = RunEstimate(estimate.name, estimate.c + offset, estimate.root, estimate.equation)
    return RunScore(off, run.equation, run.theta, run.knot_effects, run.knot_covariance)


def consistency(seed, n_runs, bad=(), shift=50.0):
    """Return the test of some runs; in those that are bad the coefficient of lambda_2 is off."""
    rng = np.random.default_rng(seed)
    runs = []
    for i in range(n_runs):
        root, equation = rng.standard_normal((K, K)), Linear(rng.standard_normal((K, P)))
        c = -np.linalg.solve(root, rng.standard_normal(K))
        estimate = RunEstimate(f"run {i}", c, root, equation)
        run = RunScore(estimate, equation, np.zeros(P), np.zeros((0, K, K)), np.zeros((0, 0)))
        runs.append(shifted(run, shift * np.eye(K)[1]) if i in bad else run)
    return ConsistencyTest(tuple(runs), np.ones(P), np.zeros((0, P)), np.zeros(0))


def scattered(seed, n_runs, width, members=slice(0, 4)):
    """Return the test of runs of which some coefficients scatter by so many of their sigmas."""
    rng, test = np.random.default_rng(seed), consistency(seed, n_runs)
    runs = []
    for run in test.runs:
        offset = np.zeros(K)
        offset[members] = width * rng.standard_normal(len(offset[members]))
        runs.append(shifted(run, offset))
    return ConsistencyTest(tuple(runs), test.width, test.prior_rows, test.prior_residual)
