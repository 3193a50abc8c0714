"""The residual of a run with everything that is refitted projected out, and further effects in it.

Let r be the whitened residual of a run, J the columns that are refitted and e that of a further effect. With
P the projection on what J leaves, least squares gives for an effect of amount a, r = e a + noise,

    a = e' P r / e' P e,        Delta chi^2 = (e' P r)^2 / e' P e .

For an effect of one amount in several runs, e' P e and e' P r add up over the runs.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RANK = 1e-8  # singular value relative to the largest, below which columns of unit length are dependent
ABSORBED = 1e-6  # share of the length of an effect that the refitted columns must leave


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
    amounts, sigmas : ndarray, shape (K,)
        Of the refitted columns: zero, and infinite, for what the data do not determine.
    """

    def __init__(self, residual: Array, refitted: Array) -> None:
        norms = np.linalg.norm(refitted, axis=0)
        present = norms > 0
        u, s, vt = np.linalg.svd(refitted[:, present] / norms[present], full_matrices=False)
        rank = int(np.count_nonzero(s > RANK * s[0])) if s.size else 0
        self._basis, inverse = u[:, :rank], vt[:rank].T / s[:rank]
        projections = self._basis.T @ residual
        self.amounts, self.sigmas = np.zeros(norms.size), np.full(norms.size, np.inf)
        self.amounts[present] = inverse @ projections / norms[present]
        self.sigmas[present] = np.linalg.norm(inverse, axis=1) / norms[present]
        self.residual = residual - self._basis @ projections

    def independent(self, effects: Array) -> Array:
        """Return P e of effects, shape (N, Q); zero for those that the refitted columns absorb."""
        remainder = np.asarray(effects - self._basis @ (self._basis.T @ effects))
        absorbed = np.linalg.norm(remainder, axis=0) < ABSORBED * np.linalg.norm(effects, axis=0)
        remainder[:, absorbed] = 0.0
        return remainder
