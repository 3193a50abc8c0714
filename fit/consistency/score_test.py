"""Score test of effects that the equation of a run lacks, with everything else refitted.

Let r be the whitened residual of a run, J the columns that are refitted and E those of further effects. With
P the projection on what J leaves, generalised least squares gives for effects of amounts a, r = E a + noise,

    a = (E' P E)^-1 E' P r,        Delta chi^2 = r' P E (E' P E)^-1 E' P r .

For an effect of one amount in several runs, E' P E and E' P r add up over the runs.
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


class ScoreTest:
    """The residual of a run with everything that is refitted projected out.

    Parameters
    ----------
    residual : ndarray, shape (N,)
        Whitened, of unit variance; rows of prior knowledge may follow those of the data.
    refitted : ndarray, shape (N, K)
        Columns of what is refitted.

    Attributes
    ----------
    residual : ndarray, shape (N,)
        What the refitted columns leave of it, P r.
    rank : int
        Number of independent columns among the refitted ones.
    refit : ScoreTestResult
        Amounts of the refitted columns, zero for what the data do not determine.
    """

    def __init__(self, residual: Array, refitted: Array) -> None:
        norms = np.linalg.norm(refitted, axis=0)
        present = norms > 0
        u, s, vt = np.linalg.svd(refitted[:, present] / norms[present], full_matrices=False)
        self.rank = int(np.count_nonzero(s > RANK * s[0])) if s.size else 0
        self._basis = u[:, : self.rank]
        amplitudes, inverse = self._basis.T @ residual, vt[: self.rank].T / s[: self.rank]
        amounts, sigmas = np.zeros(norms.size), np.full(norms.size, np.inf)
        amounts[present] = inverse @ amplitudes / norms[present]
        sigmas[present] = np.linalg.norm(inverse, axis=1) / norms[present]
        self.refit = ScoreTestResult(float(amplitudes @ amplitudes), amounts, sigmas)
        self.residual = residual - self._basis @ amplitudes

    @property
    def chi2(self) -> float:
        """Sum of squares of what the refitted columns leave."""
        return float(self.residual @ self.residual)

    def project(self, columns: Array) -> Array:
        """Return what the refitted columns leave of columns, shape (N, ...)."""
        return np.asarray(columns - self._basis @ (self._basis.T @ columns))

    def independent(self, effects: Array) -> Array:
        """Return what the refitted columns leave of effects, (N, Q); zero for those that they absorb."""
        remainder = self.project(effects)
        absorbed = np.linalg.norm(remainder, axis=0) < ABSORBED * np.linalg.norm(effects, axis=0)
        remainder[:, absorbed] = 0.0
        return remainder

    def test(self, effects: Array, known: Array | None = None) -> ScoreTestResult:
        """Return the test of effects, shape (N, Q), without a known effect, shape (N,)."""
        residual = self.residual if known is None else self.residual - self.project(known)
        return ScoreTest(residual, self.independent(effects)).refit
