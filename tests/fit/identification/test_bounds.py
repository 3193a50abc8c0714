"""Bounds that a search reaches: what is held there, by how much the data contradict it, and what rests on it.

The oracle is the normal equations, and SciPy's bounded least squares.
"""

from dataclasses import dataclass
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
import scipy

from fit.fitting import irls
from fit.identification import bounds
from fit.parameters import Parameter

N = 400


@dataclass(frozen=True)
class Data:
    """Data linear in the parameters, of unit variance; a whitened run without a window."""

    R: np.ndarray
    tone = None
    weights = SimpleNamespace(likelihood="gaussian")

    @property
    def share(self):
        return np.eye(self.R.shape[1] - 1)

    @property
    def plain(self):
        return self.R

    @property
    def size(self):
        return len(self.R)

    @property
    def H(self):
        return self.R.T @ self.R

    M = H

    def coefficients(self, theta):
        return np.concatenate([np.ones_like(theta[:1]), -theta])

    def of_run(self, _theta):
        return -np.eye(self.R.shape[1], self.R.shape[1] - 1, k=-1)

    gradient = of_run

    def without_data(self):
        return self


def problem(names, correlation=0.6):
    """Return a design, and data whose unbounded estimate is 1 for every parameter."""
    rng = np.random.default_rng(5)
    P = len(names)
    mixed = np.linalg.cholesky(np.full((P, P), correlation) + (1 - correlation) * np.eye(P))
    X = rng.standard_normal((N, P)) @ mixed.T
    noise = rng.standard_normal(N)
    noise -= X @ np.linalg.lstsq(X, noise, rcond=None)[0]
    y = X @ np.ones(P) + noise
    return X, y, np.sqrt(np.diag(np.linalg.inv(X.T @ X)))


def searched(names, low, high, start=1.0, scales=1.0):
    """Search within bounds as an identification does, but with data that are linear; in units of `scales`."""
    X, y, _ = problem(names)
    scales = np.broadcast_to(scales, len(names))
    low, high = low * scales, high * scales
    data = Data(np.column_stack([y, X / scales]))
    weighing = SimpleNamespace(name="A", settled=True, block=lambda *_: data, reach=lambda _theta: None)
    parameters = tuple(
        Parameter(name, value, 10.0 * scale, "1", 10.0, "", name, name, name, False)
        for name, value, scale in zip(names, np.clip(start * scales, low, high), scales, strict=True)
    )
    search = object.__new__(import_module("fit.identification.identify")._Search)
    search.__dict__.update(
        joint=SimpleNamespace(parameters=parameters), weighings=[weighing], bound=set(), stepped=[],
        _low=low, _high=high, _start=np.array([p.value for p in parameters]), _weak={},
        _widths=10.0 * scales, _lost=np.zeros(len(names), dtype=bool),
    )  # fmt: skip
    outcome = irls.iterate([weighing], parameters, search.priors, admitted=search.admitted)
    return outcome, search.limits(outcome)


@pytest.mark.parametrize("side", [-1, 1], ids=["upper", "lower"])
@pytest.mark.parametrize(
    ("names", "held"),
    [(("lambda_2", "omega2_2_0"), 1), (("SuspensionControl.f_u", "omega2_2_0", "C_2"), 2)],
    ids=["one", "two"],
)
@pytest.mark.parametrize("sigmas", [0.5, 3.0, 30.0])
def test_bounds_are_tested_against_the_data(names, held, sigmas, side):
    X, y, sigma = problem(names)
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    (low if side > 0 else high)[:held] = 1 + side * sigmas * sigma[:held]
    outcome, limits = searched(names, low, high)
    wanted = scipy.optimize.lsq_linear(X, y, (low, high), tol=1e-14)
    at = np.flatnonzero(wanted.active_mask)
    np.testing.assert_allclose(outcome.solution.theta, wanted.x, atol=1e-3 * sigma.min())
    assert [limit.name for limit in limits] == [names[k] for k in at]
    beyond = wanted.x[at] - 1
    statistic = beyond @ np.linalg.solve(np.linalg.inv(X.T @ X)[np.ix_(at, at)], beyond)
    probability = max(scipy.stats.chi2.sf(statistic, at.size), 1e-300)
    contradicted = probability < 1e-3  # of one bound: 3.3 sigma
    assert sigmas == 3 or contradicted == (sigmas == 30)
    for limit, k in zip(limits, at, strict=True):
        assert limit.bound == ((low if side > 0 else high)[k], side > 0)
        assert limit.free == pytest.approx(1.0, abs=1e-6)
        assert limit.sigma == pytest.approx(sigma[k], rel=1e-6)
        assert limit.pull == pytest.approx(sigmas, rel=1e-3)
        assert limit.probability == pytest.approx(probability, rel=0.05)
        assert limit.contradicted == contradicted
    (told,) = bounds.warnings(limits, [name for k, name in enumerate(names) if k not in at])
    assert told.code == ("bound_contradicted" if contradicted else "at_bound")
    assert told.kind.unsound == contradicted
    which = "lower" if side > 0 else "upper"
    assert f"{names[0]} is held at its {which} bound {limits[0].bound.value:.6g}" in told.message
    assert f"{sigmas:.2g} sigma beyond" in told.message
    moves = np.abs(wanted.x - 1) / sigma > bounds.MOVES
    assert set(told.parameters) == {name for name, moved in zip(names, moves, strict=True) if moved}


def test_estimates_within_bounds_are_not_reported():
    names = ("lambda_2", "omega2_2_0")
    _, _, sigma = problem(names)
    outcome, limits = searched(names, 1 - 3 * sigma, 1 + 3 * sigma, start=1 + 2 * sigma[0])
    np.testing.assert_allclose(outcome.solution.theta, 1.0, atol=1e-6)
    assert limits == []
    assert bounds.warnings(limits, names) == []


def test_the_scales_of_parameters_do_not_matter():
    names, scales = ("lambda_2", "alpha_phi_1", "C_2"), np.array([1e-5, 1e3, 1.0])
    _, _, sigma = problem(names, 0.0)
    low, high = np.array([1 + 30 * sigma[0], 1 + sigma[1], -np.inf]), np.full(3, np.inf)
    (_, alike), (_, scaled) = searched(names, low, high), searched(names, low, high, scales=scales)
    assert [limit.name for limit in scaled] == ["lambda_2", "alpha_phi_1"]
    assert scaled[0].contradicted
    for limit, of_equal_scales, scale in zip(scaled, alike, scales, strict=False):
        assert limit.probability == pytest.approx(of_equal_scales.probability, rel=0.01)
        assert limit.pull == pytest.approx(of_equal_scales.pull, rel=1e-3)
        assert limit.sigma == pytest.approx(of_equal_scales.sigma * scale, rel=1e-6)


def test_a_parameter_at_its_bound_for_the_sake_of_another_is_within_it():
    """At the upper bound of the first, the second wants up; without bounds it is below its own."""
    names = ("lambda_2", "C_2")
    _, _, sigma = problem(names)
    high = np.array([1 - 30 * sigma[0], 1 + 2 * sigma[1]])
    _, limits = searched(names, np.full(2, -np.inf), high)
    assert [(limit.name, limit.bound.is_lower, limit.pull > 0) for limit in limits] == [
        ("lambda_2", False, True),
        ("C_2", False, False),
    ]
    (told,) = bounds.warnings(limits, names)
    assert (
        f"C_2 is held at its upper bound {high[1]:.6g}, the data put it at 1 ± {sigma[1]:.2g}, within it"
        in (told.message)
    )


def test_bounds_on_either_side_are_reported_together():
    names = ("lambda_2", "C_2", "omega2_2_0")
    _, _, sigma = problem(names)
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    low[0], high[1] = 1 + 8 * sigma[0], 1 - 8 * sigma[1]
    _, limits = searched(names, low, high)
    assert [(limit.name, limit.bound.is_lower, limit.record["bound"]) for limit in limits] == [
        ("lambda_2", True, "min"),
        ("C_2", False, "max"),
    ]
    (told,) = bounds.warnings(limits, names)
    assert told.code == "bound_contradicted"
    assert "lambda_2 is held at its lower bound" in told.message
    assert "C_2 is held at its upper bound" in told.message
