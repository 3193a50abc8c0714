"""The posterior of the parameters of a finished joint fit, for sampling.

Its logarithm is minus half of chi^2 over the runs, as they were weighed last, plus the weak priors
(eq. jointlh). The window makes neighbouring bins one noise, so that chi^2 as it stands claims more
information than there is: its posterior would have the covariance H^-1, the estimates have H^-1 M H^-1 (see
`linear`). The chi^2 of every run is therefore divided by the mean ratio of the two, some 1.06 for Tukey 0.1,
that is 3 % in sigma. One factor for all directions of a run is not exact, as signals differ in where in the
window they lie: on the mission campaigns sigmas are off by up to 0.8 %, estimates by 0.004 sigma.
"""

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.estimate.irls import Outcome
from fit.estimate.normal import inflation

Array = NDArray[np.float64]


class Posterior:
    """The posterior about a least-squares estimate, in coordinates in which that is a unit normal.

    Parameters
    ----------
    outcome : Outcome
        Of the joint fit.

    Attributes
    ----------
    names : tuple of str
        Of the P parameters.
    centre : ndarray, shape (P,)
        The estimate, SI.
    root : ndarray, shape (P, P)
        Lower triangular; a point z is ``theta = centre + root z``.
    inflation : tuple of float
        Of every run, what its chi^2 is divided by.

    Raises
    ------
    InputError
        If the fit weighed bins by their own residual, so that its likelihood is no Gaussian.
    FitError
        If the covariance of the estimate is not positive.
    """

    def __init__(self, outcome: Outcome) -> None:
        for block in outcome.blocks:
            if not np.array_equal(block.weights.curvature, block.weights.fit):
                raise InputError(
                    "fitted with a likelihood that is not Gaussian, expected estimator 'gaussian'"
                )
        self.names = tuple(p.name for p in outcome.parameters)
        self.centre = outcome.solution.theta
        try:
            self.root = np.linalg.cholesky(outcome.solution.covariance)
        except np.linalg.LinAlgError as error:
            raise FitError(
                "the covariance of the estimate is not positive, nothing can be sampled"
            ) from error
        self._prior = outcome.prior
        self._blocks = outcome.blocks
        self.inflation = tuple(inflation(block, self.centre) for block in self._blocks)
        self._roots = [b.R / np.sqrt(k) for b, k in zip(self._blocks, self.inflation, strict=True)]

    def theta(self, z: Array) -> Array:
        """Return the parameters, SI, at points z, both of shape (..., P)."""
        return np.asarray(self.centre + z @ self.root.T)

    def __call__(self, z: Array) -> Array:
        """Return the logarithm of the density but for a constant, shape (W,), at W points, shape (W, P)."""
        theta = self.theta(z).T
        cost = np.sum((self._prior.rows @ (theta - self._prior.centre[:, None])) ** 2, axis=0)
        for block, R in zip(self._blocks, self._roots, strict=True):
            cost += np.sum((R @ block.coefficients(theta)) ** 2, axis=0)
        return np.asarray(-cost / 2)

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
