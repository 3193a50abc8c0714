"""The objective of a design: a function of the sigmas of the joint fit, to be minimised."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEEP = 60.0  # of the smooth maximum that stands for the worst ratio: right to 4 % for ten that are equal
STRICT = 300.0  # how much a parameter counts that is worse than it may be


@dataclass(frozen=True)
class Objective:
    """The objective.

    Attributes
    ----------
    indices : ndarray of int, shape (W,)
        Which of the P parameters count.
    weights : ndarray, shape (W,)
        Of the logarithms of their sigmas; they add up to one. Of no meaning for the worst ratio.
    minimax : bool
        Whether the largest sigma counts alone, in units of its scale.
    max_ratios : ndarray, shape (W,)
        What the sigmas must not exceed, in units of their scales; infinite where anything goes.
    """

    indices: NDArray[np.intp]
    weights: Array
    minimax: bool
    max_ratios: Array

    def logs(self, information: Array) -> Array:
        """Return the logarithms of the sigmas in units of their scales, shape (W,)."""
        return np.asarray(0.5 * np.log(np.diag(np.linalg.inv(information))[self.indices]))

    def value(self, logs: Array) -> float:
        """Return the objective: the weighted geometric mean of the sigmas, or the largest of them."""
        return float(np.exp(np.max(logs) if self.minimax else self.weights @ logs))

    def slope(self, logs: Array) -> tuple[float, Array]:
        """Return a smooth logarithm of the objective, penalties included, and its derivatives by `logs`."""
        over = np.maximum(logs - np.log(self.max_ratios), 0)
        penalty, of_penalty = STRICT * float(over @ over), 2 * STRICT * over
        if self.minimax:
            top = float(np.max(logs))
            powers = np.exp(STEEP * (logs - top))
            total = float(np.sum(powers))
            return top + np.log(total) / STEEP + penalty, powers / total + of_penalty
        return float(self.weights @ logs) + penalty, self.weights + of_penalty

    def dual(self, information: Array, weights: Array) -> Array:
        """Return what information is worth, shape (P, P): ``d log objective = -tr(Z dI) / 2``.

        Parameters
        ----------
        information : ndarray, shape (P, P)
            About which.
        weights : ndarray, shape (W,)
            Derivatives of the objective by the logarithms of the sigmas.
        """
        C = np.linalg.inv(information)
        rows = C[self.indices] * np.sqrt(weights / np.diag(C)[self.indices])[:, None]
        return np.asarray(rows.T @ rows)
