"""A whitened run as it is expected before there are data, and the sums over its bins."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.whitening import weights, whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ExpectedRun(whitened_run.WhitenedRun):
    """A whitened run as it is expected: noise in its columns adds to the sums over bins.

    Attributes
    ----------
    jitter : ndarray, shape (K, K)
        What noise adds to ``R^T R``.
    """

    jitter: Array = field(kw_only=True)

    @cached_property
    def R(self) -> Array:
        """As that of `WhitenedRun`."""
        rows = whitened_run.matrix_sqrt(self.jitter * np.mean(self.weights.fit))
        return whitened_run.qr_factor(np.concatenate([super().R, rows]))

    @cached_property
    def H(self) -> Array:
        """As that of `WhitenedRun`."""
        U = self.columns * np.sqrt(self.weights.curvature)[:, None]
        return np.asarray((U.conj().T @ U).real + self.jitter * np.mean(self.weights.curvature))

    @cached_property
    def M(self) -> Array:
        """As that of `WhitenedRun`."""
        # Noise runs through the whole window: where the scores of a signal weigh w^2 where it is, these
        # weigh the mean of it.
        w = np.ones(1) if self.window is None else self.window
        of_window = w.size * np.sum(w**4) / np.sum(w**2) ** 2
        return np.asarray(super().M + self.jitter * np.mean(self.weights.score) * of_window)


@dataclass(frozen=True)
class CompressedRun(whitened_run.WhitenedRun):
    """A whitened run of which only its sums over bins are left.

    Attributes
    ----------
    sums : tuple of ndarray, each of shape (K, K)
        R, H and M of `ExpectedRun`.
    bins : int
        Number of its bins.
    """

    sums: tuple[Array, Array, Array] = field(kw_only=True)
    bins: int = field(kw_only=True)

    @property
    def size(self) -> int:
        """As that of `WhitenedRun`."""
        return 2 * (self.bins - 1)

    @cached_property
    def R(self) -> Array:
        """As that of `WhitenedRun`."""
        return self.sums[0]

    @cached_property
    def plain(self) -> Array:
        """As that of `WhitenedRun`."""
        return self.sums[0]

    @cached_property
    def H(self) -> Array:
        """As that of `WhitenedRun`."""
        return self.sums[1]

    @cached_property
    def M(self) -> Array:
        """As that of `WhitenedRun`."""
        return self.sums[2]


def compress(block: whitened_run.WhitenedRun) -> CompressedRun:
    """Return what is left of a run without its bins."""
    columns, even = np.zeros((0, len(block.R)), np.complex128), weights("gaussian", np.zeros(0), np.zeros(0))
    sums, bins = (block.R, block.H, block.M), len(block.columns)
    return CompressedRun(block.tau, columns, even, None, block.parameter_map, sums=sums, bins=bins)
