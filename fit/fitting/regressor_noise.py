"""The noise of read-outs that are columns and residual at once, taken off by what the noise run has of it.

D is limited by the capacitive read-outs of y, whose second derivatives are columns of the model as well: the
square of their noise joins the scores and pulls gains towards what would make the noise least. With columns U
and residual r of the noise run, weighed alike, the mean of these scores is ``U^T r`` times the ratio of the
numbers of bins, and that is subtracted. Least squares on tilt-to-length has the same bias (arXiv 2410.16475).
"""

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.spectra import NoiseModel, Spectra
from fit.whitening import WhitenedRun, whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CorrectedRun(WhitenedRun):
    """A whitened run whose scores are corrected.

    Attributes
    ----------
    noise_scores : ndarray, shape (K - 1,)
        What the noise of the columns adds to the scores, on average.
    """

    noise_scores: Array = field(kw_only=True)

    @cached_property
    def R(self) -> Array:
        """As that of `WhitenedRun`, its first column such that ``R[:, 1:].T @ R[:, 0]`` is corrected."""
        R = self._root(self.weights.fit)
        scale = np.linalg.norm(R[:, 1:], axis=0)
        scale[scale == 0] = 1.0  # a constant channel
        shift = np.linalg.lstsq((R[:, 1:] / scale).T, self.noise_scores / scale)[0]
        return np.concatenate([R[:, :1] - shift[:, None], R[:, 1:]], axis=1)

    @cached_property
    def root_level(self) -> Array:
        """As that of `WhitenedRun`, not corrected: the residual has the power it has."""
        level = np.ones(len(self.columns)) if self.weights.level is None else self.weights.level
        return self._root(level)


def corrected(run: WhitenedRun, noise_run: Spectra, noise: NoiseModel, c: Array) -> CorrectedRun:
    """Return a whitened run without what the noise of its columns adds to the scores.

    Parameters
    ----------
    run : WhitenedRun
        The run.
    noise_run : Spectra
        The same columns of its noise run.
    noise : NoiseModel
        Of the residual.
    c : ndarray, shape (K,)
        Coefficients of the columns.
    """
    lowest = noise_run.f[0] if run.f is None else run.f[0]
    U, _ = whitened_run.whiten(noise_run, noise.expected(noise_run.f))
    rows = whitened_run.as_real(U[noise_run.f >= lowest])
    share = 2 * len(run.columns) / len(rows) * float(np.mean(run.weights.fit))
    known = {x.name: getattr(run, x.name) for x in fields(WhitenedRun)}
    return CorrectedRun(**known, noise_scores=share * (rows[:, 1:].T @ (rows @ c)))
