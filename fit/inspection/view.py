"""One whitened run as the search for long glitches sees it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.weighing import Glitch, shapes

Array = NDArray[np.float64]

LEAST = 0.2  # of a shape that constant, ramp and columns must leave, lest it be told from none


@dataclass(frozen=True)
class View:
    """A run as the pursuit sees it.

    Attributes
    ----------
    time : ndarray, shape (N,)
        Instants [s] of the samples of its columns.
    fs : float
        Sample rate [Hz].
    f, S : ndarray, shape (B,)
        Frequencies [Hz] and PSD of the noise.
    window : ndarray, shape (n,)
        Of the transform, n <= N.
    residual : ndarray, shape (2 B,)
        Real and imaginary part of every bin of the whitened residual, of variance 1 where there is but noise.
    Q : ndarray, shape (2 B, K)
        Orthonormal columns that have been projected out of it.
    own : bool
        Whether S was fitted to this very run.
    known : tuple of Glitch
        What has been found in it so far.
    """

    time: Array
    fs: float
    f: Array
    S: Array
    window: Array
    residual: Array
    Q: Array
    own: bool
    known: tuple[Glitch, ...]

    @property
    def duration(self) -> float:
        """Of what is transformed [s]."""
        return self.window.size / self.fs

    def column(self, glitch: Glitch) -> Array | None:
        """Return a glitch as a whitened column of length 1, shape (2 B,), None if little of it is left."""
        return self.columns([glitch])[0]

    def columns(self, glitches: Sequence[Glitch]) -> list[Array | None]:
        """Return the `column` of each of some glitches, which is faster than one by one."""
        series = shapes.series(glitches, self.time[: self.window.size], self.fs)
        series *= self.window
        whole = (scipy.fft.rfft(series)[:, 1 : self.f.size + 1] * self._scale).view(np.float64)
        left = whole - (whole @ self.Q) @ self.Q.T
        both = zip(left, np.linalg.norm(left, axis=1), np.linalg.norm(whole, axis=1), strict=True)
        return [column / norm if norm > LEAST * of_whole else None for column, norm, of_whole in both]

    @cached_property
    def _scale(self) -> Array:
        return np.asarray(1 / np.sqrt(self.S))

    def seen(self, glitch: Glitch) -> float:
        """Return the share of a glitch that the window leaves, from 0 to 1."""
        series = glitch.series(self.time[: self.window.size], self.fs)
        return float(np.linalg.norm(self.window * series) / max(float(np.linalg.norm(series)), 1e-300))

    def without(self, column: Array) -> "View":
        """Return the run with a further column projected out."""
        residual = self.residual - column * float(column @ self.residual)
        return replace(self, residual=residual, Q=np.column_stack([self.Q, column]))
