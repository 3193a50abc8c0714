"""Score test of effects that the equation of a run lacks, with everything else refitted.

Let r be the whitened residual of a run, J the columns that are refitted and E those of further effects. With
P the projection on what J leaves, generalised least squares gives for effects of amounts a, r = E a + noise,

    a = (E' P E)^-1 E' P r,        Delta chi^2 = r' P E (E' P E)^-1 E' P r .

The products E' P E and E' P r add up over runs that have an effect in common.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANK = 1e-8  # singular value relative to the largest, below which columns of unit length are dependent
ABSORBED = 1e-6  # share of the length of an effect that the refitted columns must leave


@dataclass(frozen=True)
class ScoreTestResult:
    """Amounts of effects and what they explain.

    Attributes
    ----------
    delta_chi2 : float
        By how much chi^2 falls with the effects.
    amounts, sigmas : ndarray, shape (Q,)
        Of the effects, each with the others; sigma is infinite for what the refitted columns absorb.
    """

    delta_chi2: float
    amounts: Array
    sigmas: Array


@dataclass(frozen=True)
class ScoreSums:
    """Sums of products of effects that are additive over runs.

    Attributes
    ----------
    information : ndarray, shape (Q, Q)
        ``E' P E``.
    scores : ndarray, shape (Q,)
        ``E' P r``.
    """

    information: Array
    scores: Array

    def __add__(self, other: "ScoreSums") -> "ScoreSums":
        """Return the sums over both."""
        return ScoreSums(self.information + other.information, self.scores + other.scores)

    def result(self) -> ScoreTestResult:
        """Return the test of all effects together."""
        norms = np.sqrt(np.diag(self.information).clip(0))
        scale = np.where(norms > 0, norms, 1.0)
        inverse = np.linalg.pinv(self.information / np.outer(scale, scale), RANK, hermitian=True)
        inverse /= np.outer(scale, scale)
        amounts = inverse @ self.scores
        sigmas = np.sqrt(np.where(norms > 0, np.diag(inverse), np.inf))
        return ScoreTestResult(float(self.scores @ amounts), amounts, sigmas)


class ScoreTest:
    """The residual of a run with everything that is refitted projected out.

    Parameters
    ----------
    residual : ndarray, shape (N,)
        Whitened, of unit variance; rows of what is known beside the data may follow.
    refitted : ndarray, shape (N, K)
        Columns of what is refitted.

    Attributes
    ----------
    residual : ndarray, shape (N,)
        What the refitted columns leave of it, P r.
    """

    def __init__(self, residual: Array, refitted: Array) -> None:
        norms = np.linalg.norm(refitted, axis=0)
        u, s, _ = np.linalg.svd(refitted[:, norms > 0] / norms[norms > 0], full_matrices=False)
        self._basis = u[:, s > RANK * s[0]] if s.size else u
        self.residual = self.project(residual)

    def project(self, columns: Array) -> Array:
        """Return what the refitted columns leave of columns, shape (N, ...)."""
        return np.asarray(columns - self._basis @ (self._basis.T @ columns))

    def sums(self, effects: Array) -> ScoreSums:
        """Return the sums of products of effects, shape (N, Q); zero for what the refitted columns absorb."""
        left = self.project(effects)
        absorbed = np.linalg.norm(left, axis=0) < ABSORBED * np.linalg.norm(effects, axis=0)
        left[:, absorbed] = 0.0
        return ScoreSums(left.T @ left, left.T @ self.residual)

    def test(self, effects: Array) -> ScoreTestResult:
        """Return the test of effects, shape (N, Q)."""
        return self.sums(effects).result()

    def test_exact(self, effect: Array) -> float:
        """Return by how much chi^2 falls with an effect, shape (N,), of amount one."""
        left = self.project(effect)
        return float(2 * left @ self.residual - left @ left)
