"""What varies from experiment to experiment more than noise makes it: a common value, and a width about it.

Each experiment departs from the common value by an unknown amount, drawn from a Gaussian whose width is
estimated along with everything else, by maximum likelihood (expectation maximisation). The sigma of the
common value then says how well the mean over all conceivable experiments is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

START = 0.01  # width to begin with, relative to the flight value; in flight lambda_2 scattered by 0.005


@dataclass(frozen=True)
class Scatter:
    """The departures of one parameter among those of a fit.

    Attributes
    ----------
    name : str
        The parameter that scatters.
    members : tuple of int
        Where the departures of the N experiments stand among the fitted parameters.
    start : float
        Width to begin with, in the unit of the parameter.
    """

    name: str
    members: tuple[int, ...]
    start: float

    def width(self, theta: Array, covariance: Array) -> float:
        """Return the width that the last estimate of theta, shape (P,), makes likely."""
        own = list(self.members)
        variance = np.diag(covariance)[own]
        return float(np.sqrt(np.mean(theta[own] ** 2 + variance))) if variance.any() else self.start

    def rows(self, theta: Array, covariance: Array) -> Array:
        """Return the knowledge that the width is, as rows of a `linear.Prior`, shape (N, P)."""
        return np.eye(theta.size)[list(self.members)] / self.width(theta, covariance)

    def estimate(self, theta: Array, covariance: Array) -> tuple[float, float]:
        """Return the width and its sigma, from the estimate of theta with that width and its covariance."""
        s = self.width(theta, covariance)
        posterior = np.diag(covariance)[list(self.members)]
        data = 1 / np.maximum(1 / posterior - 1 / s**2, 1e-12 / s**2)  # variance of a departure by itself
        return s, float(1 / np.sqrt(np.sum(2 * s**2 / (s**2 + data) ** 2)))


def rows(scatter: Sequence[Scatter], theta: Array, covariance: Array) -> Array:
    """Return the rows of all of them, shape (number of departures, P)."""
    return np.concatenate([np.empty((0, theta.size)), *(s.rows(theta, covariance) for s in scatter)])
