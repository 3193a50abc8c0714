"""Runs that share parameters, as one lmfit problem on their compressed estimates.

The residual of a run is ``V^-1/2 (c(theta) - c)``, with its coefficients c and their true covariance V (see
`run_estimate`); a Gaussian prior adds one element. It follows that

* lmfit's covariance matrix is the true covariance of the parameters, window and priors included;
* chisqr is the statistic of the consistency of the runs with each other, and nfree its degrees of freedom:
  what the runs say beyond what they are fitted with;
* a fit, or another one without a run or with a parameter fixed, takes milliseconds however long the runs are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting.run_estimate import RunEstimate

if TYPE_CHECKING:
    import lmfit
    from lmfit.minimizer import MinimizerResult

Array = NDArray[np.float64]

SINGULAR = 1e-13  # least diagonal element of the triangle of a Jacobian with columns of unit length
STEP = 1e-4  # relative, for the derivatives of expressions
INTERIOR = 1e-3  # of the distance between bounds, or of the value: how far from a bound a fit starts


class Prior(NamedTuple):
    """Gaussian knowledge of a parameter, given as ``user_data`` of an `lmfit.Parameter`."""

    mean: float
    sigma: float


@dataclass(frozen=True)
class LinearEquation:
    """Coefficients that are the parameters themselves."""

    def coefficients(self, theta: Array) -> Array:
        """Return ``(1, theta)``, shape (P + 1,)."""
        return np.concatenate([[1.0], theta])

    def gradient(self, theta: Array) -> Array:
        """Return the derivatives of `coefficients`, shape (P + 1, P)."""
        return np.eye(theta.size + 1, theta.size, k=-1)


class JointModel:
    """Runs that share parameters, as one lmfit problem.

    Parameters
    ----------
    runs : sequence of RunEstimate
        The compressed runs. Their equations take all parameters of the problem, in its order.
    """

    def __init__(self, runs: Sequence[RunEstimate]) -> None:
        self.runs = tuple(runs)

    def residual(self, params: lmfit.Parameters) -> Array:
        """Return what lmfit makes least: every run in units of its noise, then the priors, shape (N,)."""
        theta = parameter_values(params)
        priors = [(p.value - p.user_data.mean) / p.user_data.sigma for p in with_prior(params)]
        return np.concatenate([*(run.residual(theta) for run in self.runs), priors])

    def gradient(self, params: lmfit.Parameters) -> Array:
        """Return the derivatives of `residual` by all P parameters, shape (N, P)."""
        theta, rows = parameter_values(params), dict(zip(params, np.eye(len(params)), strict=True))
        priors = [rows[p.name] / p.user_data.sigma for p in with_prior(params)]
        of_runs = [run.jacobian(theta) for run in self.runs]
        return np.concatenate([*of_runs, np.reshape(priors, (-1, theta.size))])

    def jacobian(self, params: lmfit.Parameters) -> Array:
        """Return the derivatives of `residual` by the F parameters that vary, shape (N, F)."""
        return self.gradient(params) @ free_directions(params)

    def minimizer(self, params: lmfit.Parameters) -> lmfit.Minimizer:
        """Return the problem, for whatever lmfit does with one."""
        import lmfit  # slow to import

        return lmfit.Minimizer(
            self.residual, params, scale_covar=False, Dfun=self.jacobian, xtol=1e-12, ftol=1e-14, gtol=1e-15
        )

    def fit(self, params: lmfit.Parameters) -> MinimizerResult:
        """Minimise.

        Raises
        ------
        FitError
            If the minimiser fails.
        """
        try:
            result = self.minimizer(params).leastsq()
        except (
            ValueError,
            TypeError,
        ) as error:  # residuals that are no numbers, fewer of them than parameters
            raise FitError("the data and the weak priors leave a direction free") from error
        if not result.success or not np.isfinite(parameter_values(result.params)).all():
            raise FitError(f"the minimisation failed: {result.message}")
        return result

    def covariance(self, params: lmfit.Parameters) -> Array:
        """Return the true covariance of all P parameters, shape (P, P); zero for those that are fixed.

        Raises
        ------
        FitError
            If the data and the priors leave a direction free.
        """
        free = free_directions(params)
        if not free.size:
            return np.zeros((len(params), len(params)))
        J = self.gradient(params) @ free
        scale = np.linalg.norm(J, axis=0)
        if not np.all(np.isfinite(scale) & (scale > 0)) or len(J) < len(scale):
            raise FitError("the data and the weak priors leave a direction free")
        R = np.linalg.qr(J / scale, mode="r")
        if np.abs(np.diag(R)).min() < SINGULAR:
            raise FitError("the data and the weak priors leave a direction free")
        root = free @ (scipy.linalg.solve_triangular(R, np.eye(len(R))) / scale[:, None])
        return np.asarray(root @ root.T)

    def information(self, params: lmfit.Parameters) -> Array:
        """Return what the runs say of all P parameters, priors left out, shape (P, P)."""
        theta = parameter_values(params)
        J = np.concatenate([np.empty((0, theta.size)), *(run.jacobian(theta) for run in self.runs)])
        return np.asarray(J.T @ J)

    def without(self, *names: str) -> JointModel:
        """Return the problem without some of the runs."""
        return JointModel([run for run in self.runs if run.name not in names])


def parameter_values(params: lmfit.Parameters) -> Array:
    """Return the values of all P parameters, shape (P,)."""
    return np.array([p.value for p in params.values()])


def with_prior(params: lmfit.Parameters) -> list[lmfit.Parameter]:
    """Return the parameters that have a prior."""
    return [p for p in params.values() if isinstance(p.user_data, Prior)]


def free_directions(params: lmfit.Parameters) -> Array:
    """Return the derivatives of all P parameters by the F that vary, shape (P, F): ties by the chain rule."""
    names, varying = list(params), [name for name, p in params.items() if p.vary and not p.expr]
    free = np.eye(len(names))[:, [names.index(name) for name in varying]]
    tied = [i for i, name in enumerate(names) if params[name].expr]
    if not tied:
        return free
    trial = params.copy()
    for column, name in enumerate(varying):
        before, p = parameter_values(trial)[tied], trial[name]
        value = p.value
        step = STEP * (abs(value) or 1.0)
        p.value = value + step if p.max > value + step else value - step
        free[tied, column] = (parameter_values(trial)[tied] - before) / (p.value - value)
        p.value = value
    return free


def start_values(params: lmfit.Parameters) -> lmfit.Parameters:
    """Move values off their bounds, where the gradient that lmfit sees vanishes and nothing would move."""
    for p in params.values():
        if p.vary and not p.expr and np.isfinite([p.min, p.max]).any():
            span = p.max - p.min if np.isfinite(p.max - p.min) else abs(p.value) or 1.0
            low, high = p.min + INTERIOR * span, p.max - INTERIOR * span
            p.value = min(max(p.value, low), high)
    return params


def delta_chi2(best: MinimizerResult, new: MinimizerResult) -> float:
    """Return the probability of a smaller difference of chisqr, for `lmfit.conf_interval`.

    lmfit's default, an F test, is for sigmas that are known but for a factor. Those of a calibration are
    known: the difference that one fixed parameter makes is distributed as chi^2 with one degree of freedom.

    Parameters
    ----------
    best, new : MinimizerResult
        The best fit, and one with a parameter fixed.
    """
    return float(scipy.special.chdtr(max(new.nfree - best.nfree, 1), max(new.chisqr - best.chisqr, 0.0)))


def lmfit_names(names: Iterable[str]) -> list[str]:
    """Return names that lmfit takes, in whose expressions they are symbols; none comes twice."""
    symbols: dict[str, None] = {}
    for name in names:
        symbol = re.sub(r"\W", "_", name)
        while symbol in symbols:
            symbol += "_"
        symbols[symbol] = None
    return list(symbols)


def lmfit_params(names: Sequence[str], theta: Array, priors: Mapping[int, Prior]) -> lmfit.Parameters:
    """Return parameters at theta, shape (P,), with priors by their place."""
    import lmfit  # slow to import

    params = lmfit.Parameters()
    for i, (name, value) in enumerate(zip(names, theta.tolist(), strict=True)):
        params.add(name, value=value)
        params[name].user_data = priors.get(i)
    return params
