"""Bounds of a linear model with known noise, tested against the data.

The oracles are the normal equations, SciPy's bounded least squares and the Wald statistic of the bounds.
"""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy

from fit import false_alarms
from fit.fitting import NullSpace, constraints, irls
from fit.fitting.constraint_test import SHIFT_SIGMA, refit_unconstrained
from fit.parameters import Parameter
from fit.whitening import Weights
from fit.whitening.whitened_run import LinearRun

N = 400


def linear_data(names, correlation=0.6):
    """Return a design matrix, data whose least-squares estimate is 1 for every parameter, and its sigmas."""
    rng = np.random.default_rng(5)
    P = len(names)
    mixing = np.linalg.cholesky(np.full((P, P), correlation) + (1 - correlation) * np.eye(P))
    X = rng.standard_normal((N, P)) @ mixing.T
    noise = rng.standard_normal(N)
    noise -= X @ np.linalg.lstsq(X, noise, rcond=None)[0]
    y = X @ np.ones(P) + noise
    return X, y, np.sqrt(np.diag(np.linalg.inv(X.T @ X)))


def as_run(y, X):
    """Return data of unit variance as a whitened run without a window."""
    rows, even = np.column_stack([-y, X]).reshape(N // 2, 2, -1), np.ones(N // 2)
    columns = rows[:, 0] + 1j * rows[:, 1]
    weights, share = Weights(even, even, even), np.eye(X.shape[1])
    return LinearRun((0.0, 0.0), columns, weights, None, share, n_projected=0)


def bounded_fit(names, low, high, start=1.0, scales=1.0):
    """Fit within bounds, in units of `scales`; return the estimate and the test of the bounds."""
    X, y, _ = linear_data(names)
    scales = np.broadcast_to(scales, len(names))
    data = as_run(y, X / scales)
    weighing = SimpleNamespace(name="A", converged=True, block=lambda *_: data)
    values = np.clip(start, low, high) * scales
    parameters = [
        Parameter(name, value, 100.0 * scale, "1", 100.0 * scale, 0, name, name, name, False)
        for name, value, scale in zip(names, values, scales, strict=True)
    ]
    params = constraints.params(parameters)
    for p, lower, upper in zip(params.values(), low * scales, high * scales, strict=True):
        p.set(min=lower, max=upper)
    none = NullSpace(np.zeros(len(names), dtype=bool), np.empty((0, len(names)))), {}
    outcome = irls.iterate([weighing], parameters, params, weak_priors=lambda *_: none)
    return outcome, refit_unconstrained(outcome, declared=())


def at_bound(test):
    return [name for w in test.warnings if w.code == "at_bound" for name in w.parameters]


@pytest.mark.parametrize("side", [-1, 1], ids=["upper", "lower"])
@pytest.mark.parametrize(
    ("names", "n_bounds"),
    [(("lambda_2", "omega2_2_0"), 1), (("SuspensionControl.f_u", "omega2_2_0", "C_2"), 2)],
    ids=["one", "two"],
)
@pytest.mark.parametrize("sigmas", [0.5, 30.0])
def test_bounds_are_tested_against_the_data(names, n_bounds, sigmas, side):
    X, y, sigma = linear_data(names)
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    (low if side > 0 else high)[:n_bounds] = 1 + side * sigmas * sigma[:n_bounds]
    outcome, test = bounded_fit(names, low, high)
    expected = scipy.optimize.lsq_linear(X, y, (low, high), tol=1e-14)
    active = np.flatnonzero(expected.active_mask)
    np.testing.assert_allclose(outcome.solution.theta, expected.x, atol=2e-3 * sigma.min())
    assert at_bound(test) == [names[k] for k in active]
    excess = expected.x[active] - 1
    statistic = excess @ np.linalg.solve(np.linalg.inv(X.T @ X)[np.ix_(active, active)], excess)
    p_value = max(scipy.stats.chi2.sf(statistic, active.size), 1e-300)
    assert test.p_value == pytest.approx(p_value, rel=0.05)
    assert test.is_contradicted == (p_value < false_alarms.p_limit())
    contradiction = [w for w in test.warnings if w.code == "constraint_contradicted"]
    assert bool(contradiction) == test.is_contradicted
    shifted = [
        names[k] for k in np.flatnonzero(np.abs(expected.x - 1) / sigma > SHIFT_SIGMA) if k >= n_bounds
    ]
    for warning in contradiction:
        assert warning.parameters == (*(names[k] for k in active), *shifted)


def test_estimates_within_bounds_are_not_reported():
    names = ("lambda_2", "omega2_2_0")
    _, _, sigma = linear_data(names)
    outcome, test = bounded_fit(names, 1 - 3 * sigma, 1 + 3 * sigma, start=1 + 2 * sigma[0])
    np.testing.assert_allclose(outcome.solution.theta, 1.0, atol=1e-3 * sigma.min())
    assert outcome.solution.dof == N - len(names)
    assert not test.warnings


def test_the_scales_of_parameters_do_not_matter():
    names, scales = ("lambda_2", "alpha_phi_1", "C_2"), np.array([1e-5, 1e3, 1.0])
    _, _, sigma = linear_data(names)
    low, high = np.array([1 + 30 * sigma[0], 1 + sigma[1], -np.inf]), np.full(3, np.inf)
    (_, test), (_, scaled) = bounded_fit(names, low, high), bounded_fit(names, low, high, scales=scales)
    assert at_bound(scaled) == at_bound(test)
    assert scaled.is_contradicted
    assert scaled.delta_chi2 == pytest.approx(test.delta_chi2, rel=1e-3)
