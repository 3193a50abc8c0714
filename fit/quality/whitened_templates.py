"""One whitened run as the search for long glitches sees it.

A glitch is a column of the run: as many numbers as the band has, from transforms of all samples. The search
needs thousands of products of such columns with the residual. Where a glitch is over long before the run is,
these take the samples that it reaches: a product of whitened columns is one of the series themselves with a
kernel that depends on the time between two samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.spectra import windowing
from fit.telemetry import pieces
from fit.whitening import Glitch, glitch_templates

Array = NDArray[np.float64]

MIN_INDEPENDENT = (
    0.2  # of a shape that constant, ramp and columns must leave, to be distinguishable from them
)
MAX_SHARE = 0.4  # of a run: glitches that reach farther are taken as columns


@dataclass(frozen=True)
class WhitenedTemplates:
    """A run as the pursuit sees it.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Instants [s] of the samples that are transformed.
    fs : float
        Sample rate [Hz].
    f, S : ndarray, shape (B,)
        Frequencies [Hz] and PSD of the noise.
    window : ndarray, shape (n,)
        Of the transform.
    residual : ndarray, shape (2 B,)
        Real and imaginary part of every bin of the whitened residual, of variance 1 where there is but noise.
    Q : ndarray, shape (2 B, K)
        Orthonormal columns that have been projected out of it.
    is_own_psd : bool
        Whether S was fitted to this very run.
    known : tuple of Glitch
        Glitches that have been subtracted so far.
    n_runs : int
        Number of runs of the campaign that are searched.
    """

    time: Array
    fs: float
    f: Array
    S: Array
    window: Array
    residual: Array
    Q: Array
    is_own_psd: bool
    known: tuple[Glitch, ...]
    n_runs: int = 1

    @property
    def start(self) -> float:
        """The first instant [s]."""
        return float(self.time[:1][0])

    @property
    def duration(self) -> float:
        """Of what is transformed [s]."""
        return self.window.size / self.fs

    def column(self, glitch: Glitch) -> Array | None:
        """Return a glitch as a whitened column of length 1, shape (2 B,), None if little of it is left."""
        columns, independent = self._columns([glitch])
        return columns[0] if independent[0] else None

    def amplitudes(self, glitches: Sequence[Glitch]) -> Array:
        """Return the product of the residual with each of several whitened glitches of length 1, shape (G,).

        The glitches must not be far from each other. NaN where the projection leaves too little of one.
        """
        n, spans = self.window.size, [glitch_templates.reach(glitch, self.fs) for glitch in glitches]
        begin, end = min(start for start, _ in spans), max(stop for _, stop in spans)
        shortest = min(glitch.shape.tau for glitch in glitches)
        start = max(0, int((begin - self.start) * self.fs))
        stop = min(n, int((end - self.start) * self.fs) + 2)
        # what reaches beyond the ends of the run comes in again at the other end, some tau later
        inside = begin > self.start - shortest and end < self.start + self.duration + shortest
        if inside and stop - start < MAX_SHARE * n:
            return self._local_amplitudes(glitches, slice(start, stop))
        columns, independent = self._columns(glitches)
        return np.where(independent, columns @ self.residual, np.nan)

    def _columns(self, glitches: Sequence[Glitch]) -> tuple[Array, NDArray[np.bool_]]:
        """Return normalised columns, shape (G, 2 B), and which of them the projection leaves."""
        n, whole = self.window.size, np.empty((len(glitches), 2 * self.f.size))
        for some in pieces(len(glitches), length=max(1, glitch_templates.MAX_TRANSFORM // n)):
            series = glitch_templates.series(glitches[some], self.time, self.fs)
            spectra = windowing.lowest_bins(series, self.window, self.f.size + 1)[:, 1:]
            del series  # before there are others
            whole[some] = (spectra * self._scale).view(np.float64)
        columns = whole - (whole @ self.Q) @ self.Q.T
        norms = np.linalg.norm(columns, axis=1)
        independent = norms > MIN_INDEPENDENT * np.linalg.norm(whole, axis=1)
        return columns * np.where(independent, 1 / np.where(independent, norms, 1.0), 0.0)[
            :, None
        ], independent

    def _local_amplitudes(self, glitches: Sequence[Glitch], stretch: slice) -> Array:
        """Return the amplitudes of glitches that reach the samples of a stretch and no others."""
        series = glitch_templates.series(glitches, self.time[stretch], self.fs)
        products = series @ self._adjoint(stretch)
        series *= self.window[stretch]
        n = 2 << (stretch.stop - stretch.start).bit_length()
        if 3 * n // 4 >= 2 * (stretch.stop - stretch.start):
            n = 3 * n // 4
        whole = scipy.fft.rfft(series, n).view(np.float64) ** 2 @ self._weights(n)
        squares = whole - np.sum(products[:, 1:] ** 2, axis=1)
        independent = squares > MIN_INDEPENDENT**2 * whole
        return np.where(independent, products[:, 0] / np.sqrt(np.where(independent, squares, 1.0)), np.nan)

    @cached_property
    def _scale(self) -> Array:
        return np.asarray(1 / np.sqrt(self.S))

    def _adjoint(self, stretch: slice) -> Array:
        """Return what samples of a series add to its products with the residual and Q, shape (n, 1 + K).

        They are kept for some way beyond the stretch, as glitches that are moved need little more.
        """
        offset, adjoint = self._cached_adjoint.get("", (0, np.empty((0, 0))))
        if not offset <= stretch.start < stretch.stop <= offset + len(adjoint):
            length, n = stretch.stop - stretch.start, self.window.size
            offset, end = max(0, stretch.start - length), min(n, stretch.stop + length)
            adjoint = np.empty((end - offset, 1 + self.Q.shape[1]), order="F")
            for i, column in enumerate([self.residual, *self.Q.T]):
                whitened = np.ascontiguousarray(column).view(np.complex128) * self._scale
                adjoint[:, i] = windowing.inverse_transform(whitened[:, None], 1, n)[offset:end, 0]
            adjoint *= (self.window[offset:end] * (n / 2))[:, None]
            self._cached_adjoint[""] = offset, adjoint
        return adjoint[stretch.start - offset : stretch.stop - offset]

    @cached_property
    def _cached_adjoint(self) -> dict[str, tuple[int, Array]]:
        return {}

    @cached_property
    def _kernel(self) -> Array:
        """Product of whitened impulses, by the samples between them, shape (n,)."""
        n = self.window.size
        squares = np.asarray(1 / self.S, dtype=np.complex128)
        return np.asarray(windowing.inverse_transform(squares[:, None], 1, n)[:, 0] * (n / 2))

    @cached_property
    def _cached_weights(self) -> dict[int, Array]:
        return {}

    def _weights(self, n: int) -> Array:
        """Return the weights of products of transforms of n samples, of which half are zero."""
        if n not in self._cached_weights:
            kernel = np.zeros(n)
            kernel[: n // 2] = self._kernel[: n // 2]
            kernel[n // 2 + 1 :] = kernel[1 : n // 2][::-1]
            weights = scipy.fft.rfft(kernel).real * (2 / n)
            weights[[0, -1]] /= 2  # of n that are even
            self._cached_weights[n] = np.repeat(weights, 2)
        return self._cached_weights[n]

    def visible_share(self, glitch: Glitch) -> float:
        """Return the share of a glitch that the window leaves, from 0 to 1."""
        series = glitch.series(self.time, self.fs)
        return float(np.linalg.norm(self.window * series) / max(float(np.linalg.norm(series)), 1e-300))

    def remainder(self, column: Array) -> Array:
        """Return the residual without its part along a column, shape (2 B,)."""
        return self.residual - column * float(column @ self.residual)

    def project_out(self, column: Array) -> "WhitenedTemplates":
        """Return the run with a further column projected out."""
        Q = np.asfortranarray(np.column_stack([self.Q, column]))
        return replace(self, residual=self.remainder(column), Q=Q)
