"""The posterior of the parameters of a finished joint fit, for sampling.

Its logarithm is that of the likelihood of every run plus the priors (Eq. (15)). A Gaussian likelihood is
that of the compressed run, with the true covariance of its coefficients (`fit.fitting.run_estimate`). The
other likelihoods are sums over bins. The window correlates neighbouring bins, so that such a sum claims more
information than there is: its logarithm is divided by the mean ratio of true variance to claimed variance,
some 1.06 for Tukey 0.1, that is 3 % in sigma. One factor for all directions of a run is not exact, as signals
differ in where in the window they lie: on the mission campaigns sigmas are off by up to 0.8 %.

The error of a noise PSD is in no likelihood. As in the fit, it adds to the covariance of the estimate: the
density at theta is the likelihood at ``B (theta - estimate)`` from the estimate, where B turns the
curvature of the likelihood into the inverse of that covariance (curvature adjustment; Ribatet, Cooley and
Davison, Statistica Sinica 22, 2012).

Constraints of parameters hold in the posterior as in the fit: fixed parameters are no coordinates of
it, tied ones follow their expressions, the density is zero beyond bounds, and priors enter it.

Where experiments depart from what they share, the logarithms of the widths are sampled along, with their
prior. The departures themselves are integrated over: at the likeliest ones, with the curvature there, which
is exact for a Gaussian likelihood.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting import IRLSResult, Prior, RunEstimate, ScaleParameter, constraints, variance_factors
from fit.whitening import whitened_run

if TYPE_CHECKING:
    import lmfit
    from lmfit.models import ExpressionModel

Array = NDArray[np.float64]


class Posterior:
    """The posterior about a least-squares estimate, in coordinates in which that is a unit normal.

    Parameters
    ----------
    result : IRLSResult
        Of the joint fit, which has P parameters that runs share and I widths by which some scatter.

    Attributes
    ----------
    names : tuple of str
        Of the F + I coordinates: the shared parameters that vary, then logarithms of widths.
    parameters : tuple of str
        All that is shared, then logarithms of widths, P + I.
    long_tailed : ndarray of bool, shape (F + I,)
        Widths, and the parameters that scatter by them: their distributions fall slower than a normal one.
    constant : ndarray of bool, shape (P + I,)
        Which parameters are fixed.
    centre : ndarray, shape (P + I,)
        The estimate, SI.

    Raises
    ------
    FitError
        If the covariance of the estimate is not positive.
    """

    def __init__(self, result: IRLSResult) -> None:
        assert result.model and result.result
        shared, params = result.shared, result.result.params
        names = [p.name for p in result.parameters[:shared]]
        log_widths = np.array(result.log_widths).reshape(-1, 2)
        self._widths = result.random_effects
        self._shared, self._size = shared, len(result.parameters)
        self._constraints = _Constraints(params, shared)
        varying = self._constraints.varying
        self.parameters = (*names, *(f"log_width_{w.name}" for w in self._widths))
        self.names = (*(names[i] for i in varying), *self.parameters[shared:])
        self.long_tailed = np.array([n in result.scatter for n in self.names[: varying.size]], dtype=bool)
        self.long_tailed = np.append(self.long_tailed, np.ones(len(log_widths), dtype=bool))
        self.constant = np.append(self._constraints.fixed, np.zeros(len(log_widths), dtype=bool))
        self.centre = np.concatenate([result.solution.theta[:shared], log_widths[:, 0]])
        self._centre = np.concatenate([self.centre[varying], log_widths[:, 0]])
        covariance = result.solution.covariance[np.ix_(varying, varying)]
        psd_error = _psd_error(result)[np.ix_(varying, varying)]
        try:
            root = np.linalg.cholesky(self._constraints.within_bounds(covariance))
            self._adjustment = _curvature_adjustment(covariance, psd_error)
        except np.linalg.LinAlgError as error:
            raise FitError(
                "the covariance of the estimate is not positive, nothing can be sampled"
            ) from error
        self.root = scipy.linalg.block_diag(root, np.diag(log_widths[:, 1]))
        theta = result.solution.theta
        inflation = variance_factors(result.whitened_runs, theta)
        self._runs = [
            _Run(block, _likelihood(block, estimate, k), self._widths, theta)
            for block, estimate, k in zip(result.whitened_runs, result.model.runs, inflation, strict=False)
        ]

    def theta(self, z: Array) -> Array:
        """Return parameters and logarithms of widths, SI, (..., P + I), at points z, shape (..., F + I)."""
        return self._parameters(self._centre + z @ self.root.T)

    def _parameters(self, coordinates: Array) -> Array:
        """Return parameters and logarithms of widths, (..., P + I), of those that vary, (..., F + I)."""
        free = self._constraints.varying.size
        theta = np.empty((*coordinates.shape[:-1], self.centre.size))
        theta[...] = self.centre
        theta[..., self._constraints.varying] = coordinates[..., :free]
        theta[..., self._shared :] = coordinates[..., free:]
        self._constraints.tie(theta)
        return theta

    def __call__(self, z: Array) -> Array:
        """Return the logarithm of the density but for a constant, shape (W,), at W points, (W, F + I)."""
        coordinates, free = self._centre + z @ self.root.T, self._constraints.varying.size
        inside = self._constraints.inside(self._parameters(coordinates))
        shift = coordinates[:, :free] - self._centre[:free]
        coordinates[:, :free] = self._centre[:free] + shift @ self._adjustment.T
        sampled = self._parameters(coordinates)
        theta = np.zeros((self._size, len(sampled)))
        theta[: self._shared] = sampled[:, : self._shared].T
        log_widths = sampled[:, self._shared :]
        density = self._constraints.log_prior(sampled)
        for i, width in enumerate(self._widths):
            density += width.log_prior(log_widths[:, i])
        with np.errstate(invalid="ignore", over="ignore"):  # where ties make no number
            for run in self._runs:
                density += run(theta, log_widths)
        return np.where(np.isnan(density) | ~inside, -np.inf, density)

    def draw(self, rng: np.random.RandomState, n: int) -> Array:
        """Return n points of the unit normal within the bounds, shape (n, F + I)."""
        z = rng.standard_normal((n, len(self.names)))
        while (outside := ~self._constraints.inside(self.theta(z))).any():
            z[outside] = rng.standard_normal((np.count_nonzero(outside), z.shape[1]))
        return z


class _Constraints:
    """Constraints and weak priors of the P parameters that runs share.

    Attributes
    ----------
    varying : ndarray of int, shape (F,)
        Parameters that are neither fixed nor tied.
    fixed : ndarray of bool, shape (P,)
        Parameters that do not move at all.
    """

    def __init__(self, params: "lmfit.Parameters", shared: int) -> None:
        self._names = list(params)
        every = list(params.values())[:shared]
        self.varying = np.flatnonzero(~constraints.fixed_or_tied(params)[:shared])
        self.fixed = np.array([not p.vary and not p.expr for p in every], dtype=bool)
        self._bounds = np.array([(p.min, p.max) for p in every]).reshape(-1, 2)[self.varying]
        priors = {i: p.user_data for i, p in enumerate(every) if isinstance(p.user_data, Prior)}
        self._prior = list(priors)
        self._mean, self._sigma = np.array([*priors.values()]).reshape(-1, 2).T
        self._ties = _ties({p.name: p.expr for p in every if p.expr})

    def within_bounds(self, covariance: Array) -> Array:
        """Return a covariance of the parameters that vary, (F, F), no wider than between their bounds."""
        C = covariance.copy()
        for i in np.flatnonzero(np.isfinite(self._bounds).all(axis=1)):
            uniform = np.ptp(self._bounds[i]) ** 2 / 12
            C -= np.outer(C[:, i], C[i]) / (C[i, i] + uniform)
        return C

    def tie(self, theta: Array) -> None:
        """Set tied parameters of theta, shape (..., P + I), to their expressions."""
        for name, symbols, model in self._ties:
            values = {symbol: theta[..., self._names.index(symbol)] for symbol in symbols}
            with np.errstate(all="ignore"):
                theta[..., self._names.index(name)] = model.eval(**values)

    def inside(self, theta: Array) -> NDArray[np.bool_]:
        """Return which of the points theta, shape (W, P + I), are within the bounds and finite."""
        x = theta[:, self.varying]
        low, high = self._bounds.T
        return np.asarray(np.all((low <= x) & (x <= high), axis=1) & np.isfinite(theta).all(axis=1))

    def log_prior(self, theta: Array) -> Array:
        """Return the logarithm of the prior, shape (W,), at theta, shape (W, P + I)."""
        return np.asarray(-np.sum(((theta[:, self._prior] - self._mean) / self._sigma) ** 2, axis=1) / 2)


def _psd_error(result: IRLSResult) -> Array:
    """Return what errors of the noise PSDs add to the covariance of the estimate, shape (P, P)."""
    assert result.model and result.result
    rows, params = result.conditional_prior.rows, result.result.params
    covariance = whitened_run.scaled_inverse(result.model.information(params) + rows.T @ rows)
    return np.asarray(covariance @ result.model.psd_scores(params) @ covariance)


def _curvature_adjustment(covariance: Array, psd_error: Array) -> Array:
    """Return the map B, shape (F, F), after which a density of covariance less `psd_error` has `covariance`.

    With ``C = L L^T``, B is the symmetric root of ``L^-1 (C - E) L^-T`` in the coordinates of L.
    """
    L = np.linalg.cholesky(covariance)
    E = np.linalg.solve(L, np.linalg.solve(L, psd_error).T)
    values, vectors = np.linalg.eigh(np.eye(len(L)) - E)
    if np.any(values <= 0):
        raise np.linalg.LinAlgError
    root = (vectors * np.sqrt(values)) @ vectors.T
    return np.asarray(L @ np.linalg.solve(L.T, root.T).T)


def _ties(expressions: Mapping[str, str]) -> "list[tuple[str, list[str], ExpressionModel]]":
    """Return tied parameters, the symbols of their expressions and these, in the order of evaluation."""
    from lmfit.models import ExpressionModel  # slow to import

    symbols = {
        name: sorted(constraints.symbols(expr, name) - {*constraints.FUNCTIONS})
        for name, expr in expressions.items()
    }
    return [
        (name, symbols[name], ExpressionModel(expressions[name], independent_vars=symbols[name]))
        for name in TopologicalSorter(symbols).static_order()
        if name in expressions
    ]


@dataclass(frozen=True)
class _Likelihood:
    """The likelihood of a run.

    Attributes
    ----------
    cost : callable
        Minus its logarithm, shape (W,), of coefficients of its columns, shape (K, W).
    weight, curvature : ndarray, shape (K, K)
        Of the squares of the coefficients in the cost as it is weighted, and second derivatives of the cost.
    """

    cost: Callable[[Array], Array]
    weight: Array
    curvature: Array


def _likelihood(block: whitened_run.WhitenedRun, estimate: RunEstimate, inflation: float) -> _Likelihood:
    """Return the likelihood that a run was fitted with; one that is not Gaussian over `inflation`."""
    if block.weights.likelihood == "gaussian":
        R = estimate.root @ np.hstack([-estimate.c[:, None], np.eye(estimate.c.size)])
        return _Likelihood(lambda c: np.asarray(np.sum((R @ c) ** 2, axis=0) / 2), R.T @ R, R.T @ R)
    power = _bin_power(block) if block.weights.likelihood == "student_t" else _band_power(block)
    weight = block.R.T @ block.R
    return _Likelihood(
        lambda c: block.weights.cost(power(c)) / inflation, weight / inflation, block.H / inflation
    )


def _bin_power(block: whitened_run.WhitenedRun) -> Callable[[Array], Array]:
    """Return the function from coefficients, (K, W), to the residual power of the bins, (B, W)."""
    U = np.concatenate([block.columns.real, block.columns.imag])
    return lambda c: np.asarray(((U @ c) ** 2).reshape(2, -1, c.shape[1]).sum(axis=0))


def _band_power(block: whitened_run.WhitenedRun) -> Callable[[Array], Array]:
    """Return the function from coefficients, (K, W), to the sums of the residual power over the bands."""
    roots = [block.root(band) for band in block.weights.bands]
    return lambda c: np.array([np.sum((R @ c) ** 2, axis=0) for R in roots])


class _Run:
    """The logarithm of the likelihood of one run, its departures integrated over.

    Parameters
    ----------
    block : WhitenedRun
        The run.
    likelihood : _Likelihood
        Of the coefficients of its columns.
    widths : sequence of ScaleParameter
        What departs.
    theta : ndarray, shape (P,)
        The estimate.
    """

    def __init__(
        self,
        block: whitened_run.WhitenedRun,
        likelihood: _Likelihood,
        widths: Sequence[ScaleParameter],
        theta: Array,
    ) -> None:
        self._block, self._likelihood = block, likelihood
        departures = [
            (member, i, unit)
            for i, width in enumerate(widths)
            for member, unit in zip(width.members, width.units, strict=True)
            if block.parameter_map[:, member].any()
        ]
        self._of_width = np.array([i for _, i, _ in departures], dtype=int)
        self._units = np.array([unit for _, _, unit in departures])
        gradient = block.gradient(theta)[:, [member for member, _, _ in departures]]
        self._gradient = gradient * self._units
        self._pull = self._gradient.T @ likelihood.weight
        self._weight = self._pull @ self._gradient
        self._curvature = self._gradient.T @ likelihood.curvature @ self._gradient

    def __call__(self, theta: Array, log_widths: Array) -> Array:
        """Return it for theta, shape (P, W), whose departures are zero, and the widths, shape (W, I)."""
        c = self._block.coefficients(theta)
        if not self._units.size:
            return -self._likelihood.cost(c)
        width = np.exp(log_widths[:, self._of_width])  # of departures in their units
        # the weights hold wherever the departures may absorb the residual, the curvature only there
        weight, A = (
            np.eye(self._units.size) + width[:, :, None] * H * width[:, None, :]
            for H in (self._weight, self._curvature)
        )
        x = -np.linalg.solve(weight, (width * (self._pull @ c).T)[:, :, None])[:, :, 0]
        likeliest = c + self._gradient @ (width * x).T
        integral = np.sum(x**2, axis=1) / 2 + np.linalg.slogdet(A)[1] / 2
        return np.asarray(-self._likelihood.cost(likeliest) - integral)
