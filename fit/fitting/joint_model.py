"""Runs that share parameters, as one lmfit problem on their compressed estimates (Eq. (15)).

The residual of a run is ``V^-1/2 (c(theta) - c)``, with its coefficients c and their true covariance V (see
`run_estimate`); a Gaussian prior adds one element. It follows that

* the covariance matrix is the true one of the parameters, window, error of the PSD and priors included;
* chisqr is the statistic of the consistency of the runs with each other, and nfree its degrees of freedom:
  what the runs say beyond what they are fitted with;
* a fit, or another one without a run or with a parameter fixed, takes milliseconds however long the runs are.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
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


class Prior(NamedTuple):
    """A Gaussian prior of a parameter, given as ``user_data`` of an `lmfit.Parameter`."""

    mean: float
    sigma: float


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
        rows, centre = prior_rows(params)
        return np.concatenate([*(run.residual(theta) for run in self.runs), rows @ theta - centre])

    def gradient(self, params: lmfit.Parameters) -> Array:
        """Return the derivatives of `residual` by all P parameters, shape (N, P)."""
        theta = parameter_values(params)
        return np.concatenate([*(run.jacobian(theta) for run in self.runs), prior_rows(params)[0]])

    def jacobian(self, params: lmfit.Parameters) -> Array:
        """Return the derivatives of `residual` by the F parameters that vary, shape (N, F)."""
        return self.gradient(params) @ free_directions(params)

    def minimizer(self, params: lmfit.Parameters) -> lmfit.Minimizer:
        """Return the problem with its derivatives and tolerances, for least squares."""
        import lmfit  # slow to import

        return lmfit.Minimizer(
            self.residual, params, scale_covar=False, Dfun=self.jacobian, xtol=1e-12, ftol=1e-14, gtol=1e-15
        )

    def fit(self, params: lmfit.Parameters) -> MinimizerResult:
        """Minimise chi^2, and state the uncertainties by `covariance`.

        Where the estimate is beyond bounds, by an active-set method, whose estimates reach them.

        Raises
        ------
        FitError
            If the minimiser fails.
        """
        if not any(p.vary for p in params.values()):
            return self._evaluate(params)
        unbounded = params.copy()
        limits = {p.name: (p.min, p.max) for p in params.values() if p.vary and not p.expr}
        for name, (low, high) in limits.items():
            unbounded[name].set(value=min(max(params[name].value, low), high), min=-np.inf, max=np.inf)
        try:
            result = self.minimizer(unbounded).leastsq()
            if all(low <= result.params[name].value <= high for name, (low, high) in limits.items()):
                for name, (low, high) in limits.items():
                    result.params[name].set(min=low, max=high)
            else:
                bounded = params.copy()
                for name, value in self._values_within(unbounded, limits).items():
                    bounded[name].value = value
                with np.errstate(all="ignore"):  # its own covariance is that of badly scaled parameters
                    result = self.minimizer(bounded).least_squares(method="dogbox", x_scale="jac", gtol=1e-12)
        except (ValueError, TypeError) as error:  # residuals that are no numbers, fewer than parameters
            raise FitError("the data and the weak priors leave a direction free") from error
        if not result.success or not np.isfinite(parameter_values(result.params)).all():
            raise FitError(f"the minimisation failed: {result.message}")
        if result.var_names:
            self._set_covariance(result)
        return result

    def _evaluate(self, params: lmfit.Parameters) -> MinimizerResult:
        """Return the result of a fit without any parameter that varies, which lmfit refuses."""
        from lmfit.minimizer import MinimizerResult  # slow to import

        residual = self.residual(params)
        if not np.isfinite(residual).all():
            raise FitError("the residual of the fixed parameters is no finite number")
        n, chi2 = residual.size, float(residual @ residual)
        criterion = n * np.log(max(chi2, np.finfo(float).tiny) / n)  # without a term of variables
        statistics = {"chisqr": chi2, "redchi": chi2 / n, "aic": criterion, "bic": criterion}
        counts = {"nfev": 1, "nvarys": 0, "ndata": n, "nfree": n}
        state = {"success": True, "errorbars": True, "aborted": False, "message": "no parameter varies"}
        variables: dict[str, object] = {"var_names": [], "init_vals": [], "init_values": {}}
        return MinimizerResult(
            params=params.copy(),
            method="evaluation",
            residual=residual,
            **{**statistics, **counts, **state, **variables},
        )

    def _values_within(
        self, unbounded: lmfit.Parameters, limits: Mapping[str, tuple[float, float]]
    ) -> dict[str, float]:
        """Return estimates of the parameters that have limits, with those beyond them held there.

        The active-set method ends when all steps are small compared with the largest parameter. It starts
        from here, since ``leastsq`` scales every parameter by itself.
        """
        bounded = unbounded.copy()
        while any(p.vary for p in bounded.values()):
            values = self.minimizer(bounded).leastsq().params.valuesdict()
            violations = {
                name: min(max(values[name], low), high)
                for name, (low, high) in limits.items()
                if bounded[name].vary and not low <= values[name] <= high
            }
            if not violations:
                break
            for name, value in violations.items():
                bounded[name].set(value=value, vary=False)
        else:
            values = bounded.valuesdict()
        return {name: values[name] for name in limits}

    def _set_covariance(self, result: MinimizerResult) -> None:
        """Have lmfit state the true covariance, the error of the PSD included."""
        indices = [list(result.params).index(name) for name in result.var_names]
        result.covar = self.covariance(result.params)[np.ix_(indices, indices)]
        sigma = np.sqrt(np.diag(result.covar))
        correlation = result.covar / np.outer(sigma, sigma)
        for name, stderr, row in zip(result.var_names, sigma.tolist(), correlation.tolist(), strict=True):
            result.params[name].stderr = stderr
            correlations = zip(result.var_names, row, strict=True)
            result.params[name].correl = {
                other_name: r for other_name, r in correlations if other_name != name
            }
        result.errorbars = True
        result.uvars = result.params.create_uvars(covar=result.covar)

    def covariance(self, params: lmfit.Parameters) -> Array:
        """Return the true covariance of all P parameters, shape (P, P); zero for those that are fixed.

        Raises
        ------
        FitError
            If the data and the priors leave a direction free.
        """
        covariance = self.inverse_information(params)
        return np.asarray(covariance + covariance @ self.psd_scores(params) @ covariance)

    def inverse_information(self, params: lmfit.Parameters) -> Array:
        """Return the covariance of all P parameters without the errors of the PSDs, as `covariance`."""
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

    def psd_scores(self, params: lmfit.Parameters) -> Array:
        """Return the covariance of the gradient of chi^2 / 2 that errors of the PSDs make, shape (P, P)."""
        theta = parameter_values(params)
        scores = np.zeros((theta.size, theta.size))
        for run in self.runs:
            if run.psd_covariance is not None:
                J = run.jacobian(theta)
                scores += J.T @ run.psd_covariance @ J
        return scores

    def information(self, params: lmfit.Parameters) -> Array:
        """Return the information of the runs on all P parameters, priors left out, shape (P, P)."""
        theta = parameter_values(params)
        jacobians = [run.jacobian(theta) for run in self.runs]
        return sum((J.T @ J for J in jacobians), np.zeros((theta.size, theta.size)))

    def score(self, params: lmfit.Parameters) -> Array:
        """Return the gradient of chi^2 / 2 of the runs by all P parameters, priors left out, shape (P,)."""
        theta = parameter_values(params)
        gradients = [run.jacobian(theta).T @ run.residual(theta) for run in self.runs]
        return sum(gradients, np.zeros(theta.size))

    def exclude(self, *names: str) -> JointModel:
        """Return the problem without some of the runs."""
        return JointModel([run for run in self.runs if run.name not in names])


def parameter_values(params: lmfit.Parameters) -> Array:
    """Return the values of all P parameters, shape (P,)."""
    return np.array([p.value for p in params.values()])


def prior_rows(params: lmfit.Parameters) -> tuple[Array, Array]:
    """Return priors as rows of chi^2, ``|rows @ theta - centre|^2``, of shapes (N, P) and (N,)."""
    priors = {i: p.user_data for i, p in enumerate(params.values()) if isinstance(p.user_data, Prior)}
    rows, centre = np.zeros((len(priors), len(params))), np.zeros(len(priors))
    for n, (i, prior) in enumerate(priors.items()):
        rows[n, i], centre[n] = 1 / prior.sigma, prior.mean / prior.sigma
    return rows, centre


def varying(params: lmfit.Parameters) -> list[int]:
    """Return the places of the F parameters that vary, neither fixed nor tied."""
    return [i for i, p in enumerate(params.values()) if p.vary and not p.expr]


def free_directions(params: lmfit.Parameters) -> Array:
    """Return the derivatives of all P parameters by the F that vary, shape (P, F): ties by the chain rule."""
    names = list(params)
    free = np.eye(len(names))[:, varying(params)]
    tied = [i for i, name in enumerate(names) if params[name].expr]
    if not tied:
        return free
    shifted = params.copy()
    for column, name in enumerate(names[i] for i in varying(params)):
        p, value_at_fit, step = shifted[name], params[name].value, STEP * (abs(params[name].value) or 1.0)
        ends = []
        for value in (max(value_at_fit - step, p.min), min(value_at_fit + step, p.max)):
            p.value = value
            ends.append(parameter_values(shifted)[tied])
        free[tied, column] = (ends[1] - ends[0]) / (
            min(value_at_fit + step, p.max) - max(value_at_fit - step, p.min)
        )
        p.value = value_at_fit
    return free


def lmfit_symbol(name: str) -> str:
    """Return the name of a parameter as expressions of lmfit take it, without the dot of an FMU."""
    return re.sub(r"\W", "_", name)


def lmfit_names(names: Iterable[str]) -> list[str]:
    """Return names that lmfit takes, in whose expressions they are symbols; none comes twice."""
    symbols: dict[str, None] = {}
    for name in names:
        symbol = lmfit_symbol(name)
        while symbol in symbols:
            symbol += "_"
        symbols[symbol] = None
    return list(symbols)
