"""What varies from experiment to experiment more than noise makes it: a common value, and a width about it.

Each experiment departs from the common value by an unknown amount, drawn from a Gaussian whose width is
estimated along with everything else, by restricted maximum likelihood. The sigma of the common value then
says how well the mean over all conceivable experiments is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

START = 0.01  # width to begin with, relative to the flight value; in flight lambda_2 scattered by 0.005
LEAST = 0.03  # smallest width, in sigmas of a single experiment: adds nothing to any sigma


@dataclass(frozen=True)
class Scatter:
    """The departures of one parameter among those of a fit.

    Attributes
    ----------
    name : str
        The parameter that scatters.
    common : int
        Where its common value stands among the P fitted parameters.
    members : tuple of int
        Where the departures of the N experiments stand among them.
    start : float
        Width to begin with, in the unit of the parameter.
    """

    name: str
    common: int
    members: tuple[int, ...]
    start: float

    def rows(self, size: int, width: float) -> Array:
        """Return what the width tells of the departures, as rows of a `linear.Prior`, shape (N, P)."""
        return np.eye(size)[list(self.members)] / width

    def estimate(self, theta: Array, H: Array, width: float) -> tuple[float, float]:
        """Return the likeliest width, and its sigma.

        Parameters
        ----------
        theta : ndarray, shape (P,)
            The estimate with departures of `width`.
        H : ndarray, shape (P, P)
            Information of all but that width.
        width : float
            What theta was estimated with.
        """
        own = np.array(self.members)
        # The value y of each experiment by itself takes the place of its departure and of the common value.
        kept = np.delete(np.arange(theta.size), self.common)
        among = np.searchsorted(kept, own)
        weak = np.zeros(kept.size)
        weak[among] = 1 / (100 * self.start) ** 2
        scale = 1 / np.sqrt(np.diag(H)[kept] + weak)
        K = (H[np.ix_(kept, kept)] + np.diag(weak)) * np.outer(scale, scale)
        V = (np.linalg.inv(K) * np.outer(scale, scale))[np.ix_(among, among)]
        y = theta[own] + V @ theta[own] / width**2  # its common value is left out: only differences count
        values, vectors = np.linalg.eigh(V)
        ones = vectors.sum(axis=0)
        rotated = vectors.T @ y

        def cost(log_s: float) -> float:
            C = values + np.exp(2 * log_s)
            weight = np.sum(ones**2 / C)
            mean = np.sum(ones * rotated / C) / weight
            left = np.sum((rotated - mean * ones) ** 2 / C)
            return float(np.sum(np.log(C)) + np.log(weight) + left)

        # the experiments that tell the parameter, not those that have hardly a signal in it
        alone = float(np.sort(np.sqrt(np.diag(V)))[: max(2, own.size // 2)].mean())
        low, high = np.log(LEAST * alone), np.log(10 * self.start)
        s = float(np.exp(scipy.optimize.minimize_scalar(cost, bounds=(low, high), method="bounded").x))
        C = V + s**2 * np.eye(own.size)
        inverse = np.linalg.inv(C)
        once = inverse.sum(axis=0)
        P = inverse - np.outer(once, once) / once.sum()
        of_square = float(np.sqrt(2 / np.sum(P * P.T)))
        return s, min(of_square / (2 * s), of_square**0.5)


def rows(scatter: Sequence[Scatter], size: int, widths: Sequence[float]) -> Array:
    """Return the rows of all of them, shape (number of departures, P)."""
    parts = (s.rows(size, width) for s, width in zip(scatter, widths, strict=True))
    return np.concatenate([np.empty((0, size)), *parts])
