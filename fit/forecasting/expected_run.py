"""The sums over bins that are expected of a whitened run before there are data."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fit.whitening import weights, whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CompressedRun(whitened_run.WhitenedRun):
    """A whitened run of which only its sums over bins are left.

    Attributes
    ----------
    R, H, M : ndarray, each of shape (K, K)
        The sums, see `WhitenedRun`.
    bins : int
        Number of its bins.
    """

    R: Array = field(kw_only=True)
    H: Array = field(kw_only=True)
    M: Array = field(kw_only=True)
    bins: int = field(kw_only=True)

    @property
    def size(self) -> int:
        """As that of `WhitenedRun`."""
        return 2 * (self.bins - 1)


def compress(block: whitened_run.WhitenedRun, jitter: Array | None = None) -> CompressedRun:
    """Return the sums of a run without its bins.

    Parameters
    ----------
    block : WhitenedRun
        The run without noise in its K columns.
    jitter : ndarray, shape (K, K), optional
        Expected sum over the bins of the products of the noise in its columns.
    """
    R, H, M = block.R, block.H, block.M
    if jitter is not None:
        fit, curvature, score = (
            float(np.mean(w)) for w in (block.weights.fit, block.weights.curvature, block.weights.score)
        )
        R = whitened_run.qr_factor(np.concatenate([R, whitened_run.matrix_sqrt(jitter * fit)]))
        # Noise runs through the whole window: where the scores of a signal weigh w^2 where it is, these
        # weigh the mean of it.
        w = np.ones(1) if block.window is None else block.window
        H, M = H + jitter * curvature, M + jitter * score * w.size * np.sum(w**4) / np.sum(w**2) ** 2
    columns, even = np.zeros((0, len(R)), np.complex128), weights("gaussian", np.zeros(0), np.zeros(0))
    share, equation, bins = block.parameter_map, block.equation, len(block.columns)
    return CompressedRun(block.tau, columns, even, None, share, equation=equation, R=R, H=H, M=M, bins=bins)
