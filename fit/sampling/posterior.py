"""The posterior of the parameters of a finished joint fit, for sampling.

Its logarithm is that of the likelihood of every run (`likelihood`) plus the weak priors (eq. jointlh). The
window makes neighbouring bins one noise, so that a likelihood as it stands claims more information than there
is: for chi^2 the posterior would have the covariance H^-1, the estimates have H^-1 M H^-1 (see `linear`). The
logarithm for every run is therefore divided by the mean ratio of the two, some 1.06 for Tukey 0.1, that is
3 % in sigma. One factor for all directions of a run is not exact, as signals differ in where in the window
they lie: on the mission campaigns sigmas are off by up to 0.8 %, estimates by 0.004 sigma.

Where experiments depart from what they share, the logarithms of the widths are sampled along, with their
prior. The departures themselves are integrated over: at the likeliest ones, with the curvature there, which
is exact for a Gaussian likelihood.
"""

from collections.abc import Callable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting import IRLSResult, ScaleParameter, inflations
from fit.whitening import NU, whitened_run

Array = NDArray[np.float64]


class Posterior:
    """The posterior about a least-squares estimate, in coordinates in which that is a unit normal.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.

    Attributes
    ----------
    names : tuple of str
        Of the P parameters: those that runs share, then logarithms of widths.
    long_tailed : ndarray of bool, shape (P,)
        Widths, and the parameters that scatter by them: their distributions fall slower than a normal one.
    centre : ndarray, shape (P,)
        The estimate, SI.
    root : ndarray, shape (P, P)
        Lower triangular; a point z is ``theta = centre + root z``.
    inflation : tuple of float
        Of every run, what its likelihood is divided by.

    Raises
    ------
    FitError
        If the covariance of the estimate is not positive.
    """

    def __init__(self, outcome: IRLSResult) -> None:
        self._widths = outcome.departing
        shared = outcome.shared
        logs = np.array(outcome.log_widths).reshape(-1, 2)
        names = [p.name for p in outcome.parameters[:shared]]
        self.names = (*names, *(f"log_width_{w.name}" for w in self._widths))
        self.centre = np.concatenate([outcome.solution.theta[:shared], logs[:, 0]])
        self.long_tailed = np.array([n in outcome.scatter for n in names] + len(logs) * [True], dtype=bool)
        try:
            root = np.linalg.cholesky(outcome.solution.covariance[:shared, :shared])
        except np.linalg.LinAlgError as error:
            raise FitError(
                "the covariance of the estimate is not positive, nothing can be sampled"
            ) from error
        self.root = scipy.linalg.block_diag(root, np.diag(logs[:, 1]))
        self._shared, self._all = shared, len(outcome.parameters)
        self._prior = whitened_run.Prior(outcome.prior.centre[:shared], outcome.prior.rows[:, :shared])
        theta = outcome.solution.theta
        self.inflation = inflations(outcome.blocks, theta)
        self._runs = [
            _Run(block, k, self._widths, theta)
            for block, k in zip(outcome.blocks, self.inflation, strict=True)
        ]

    def theta(self, z: Array) -> Array:
        """Return the parameters, SI, at points z, both of shape (..., P)."""
        return np.asarray(self.centre + z @ self.root.T)

    def __call__(self, z: Array) -> Array:
        """Return the logarithm of the density but for a constant, shape (W,), at W points, shape (W, P)."""
        sampled = self.theta(z)
        theta = np.zeros((self._all, len(sampled)))
        theta[: self._shared] = sampled[:, : self._shared].T
        logs = sampled[:, self._shared :]
        known = self._prior.rows @ (theta[: self._shared] - self._prior.centre[:, None])
        density = -np.sum(known**2, axis=0) / 2
        for i, width in enumerate(self._widths):
            density += width.log_prior(logs[:, i])
        for run in self._runs:
            density += run(theta, logs)
        return np.asarray(density)

    @property
    def sigma(self) -> Array:
        """Sigmas of the estimate, SI, shape (P,)."""
        return np.asarray(np.sqrt(np.sum(self.root**2, axis=1)))

    @property
    def fingerprint(self) -> Array:
        """The density at the estimate and a sigma beside it, shape (P + 1,): no two posteriors agree in it.

        A digest of bits would not do: the last digit depends on the number of threads of the linear algebra,
        and it is 1e-8 that such a density may differ by.
        """
        return self(np.eye(len(self.names) + 1, len(self.names), k=-1))


class _Run:
    """The logarithm of the likelihood of one run, its departures integrated over."""

    def __init__(
        self,
        block: whitened_run.WhitenedRun,
        inflation: float,
        widths: Sequence[ScaleParameter],
        theta: Array,
    ) -> None:
        self._block, self._inflation = block, inflation
        self._cost = cost(block)
        of_run = [
            (member, i, unit)
            for i, width in enumerate(widths)
            for member, unit in zip(width.members, width.units, strict=True)
            if block.share[:, member].any()
        ]
        self._of_width = np.array([i for _, i, _ in of_run], dtype=int)
        self._units = np.array([unit for _, _, unit in of_run])
        to_columns = block.gradient(theta)[:, [member for member, _, _ in of_run]]
        self._to_columns = to_columns * self._units
        self._pull = self._to_columns.T @ block.R.T @ block.R / inflation
        self._weighed = self._pull @ self._to_columns
        self._H = self._to_columns.T @ block.H @ self._to_columns / inflation

    def __call__(self, theta: Array, logs: Array) -> Array:
        """Return it for theta, shape (P, W), whose departures are zero, and the widths, shape (W, I)."""
        c = self._block.coefficients(theta)
        if not self._units.size:
            return -self._cost(c) / self._inflation
        width = np.exp(logs[:, self._of_width])  # of departures in their units
        # the weights hold wherever the departures may take up what the others leave, the curvature only there
        weighed, A = (
            np.eye(self._units.size) + width[:, :, None] * H * width[:, None, :]
            for H in (self._weighed, self._H)
        )
        x = -np.linalg.solve(weighed, (width * (self._pull @ c).T)[:, :, None])[:, :, 0]
        likeliest = c + self._to_columns @ (width * x).T
        integral = np.sum(x**2, axis=1) / 2 + np.linalg.slogdet(A)[1] / 2
        return np.asarray(-self._cost(likeliest) / self._inflation - integral)


def cost(block: whitened_run.WhitenedRun) -> Callable[[Array], Array]:
    """Return minus the logarithm of the likelihood of a run, of coefficients of its columns, shape (K, W)."""
    if block.weights.likelihood == "student_t":
        U = np.concatenate([block.columns.real, block.columns.imag])

        def of_bins(c: Array) -> Array:
            power = ((U @ c) ** 2).reshape(2, -1, c.shape[1]).sum(axis=0)
            return np.asarray((NU + 2) / 2 * np.sum(np.log1p(power / NU), axis=0))

        return of_bins
    if block.weights.likelihood == "marginalised":
        sizes = [band.stop - band.start for band in block.weights.bands]
        roots = [block.root(band) for band in block.weights.bands]

        def of_bands(c: Array) -> Array:
            parts = (n * np.log(np.sum((R @ c) ** 2, axis=0)) for n, R in zip(sizes, roots, strict=True))
            return np.asarray(np.sum(list(parts), axis=0))

        return of_bands
    R = block.R
    return lambda c: np.asarray(np.sum((R @ c) ** 2, axis=0) / 2)
