"""Window and transform: the spectra of the columns of one run in the fitted band."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.requirements import F_MAX, GAP_TAPER, TAPER
from fit.spectra.derivatives import true_runs
from fit.telemetry import pieces

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]


def window(valid: NDArray[np.bool_], fs: float, taper: float = TAPER, gap_taper: float = GAP_TAPER) -> Array:
    """Return a Tukey window over the run with a smooth notch at every masked stretch, shape (N,)."""
    if valid.all():
        return _tukey(valid.size, taper)
    n, w = np.arange(valid.size), _tukey(valid.size, taper).copy()
    for start, stop in true_runs(~valid):
        distance = np.maximum(np.maximum(start - n, n - stop + 1), 0) / (gap_taper * fs)
        w *= np.sin(np.pi / 2 * np.minimum(distance, 1)) ** 2
    return w


@lru_cache(maxsize=8)  # the runs of a campaign have few lengths
def _tukey(n: int, taper: float) -> Array:
    w = np.asarray(scipy.signal.windows.tukey(n + 2, taper)[1:-1], dtype=np.float64)
    w.setflags(write=False)  # cached
    return w


@dataclass(frozen=True)
class Spectra:
    """Windowed columns of one run in the fitted band.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz], from the first bin up: the lowest belong to the band, see `linear`.
    columns : ndarray of complex, shape (B, P)
        Transforms of the windowed columns, scaled so that the mean of ``|.|^2`` is the one-sided PSD.
    nuisance : ndarray of complex, shape (B, 2 + G)
        Those of a constant, a ramp and G further series, to be projected out.
    window : ndarray, shape (N,)
        The window, zero where samples are masked.
    tau : tuple of float
        The delays [s] about which the columns were expanded, zero where they know none.
    first : int
        Number of the first bin in the transform of N samples.
    """

    f: Array
    columns: Spectrum
    nuisance: Spectrum
    window: Array
    tau: tuple[float, float] = (0.0, 0.0)
    first: int = 1

    @property
    def bins(self) -> slice:
        """Which bins of the transform of the whole run they are."""
        return slice(self.first, self.first + self.f.size)

    def band(self, low: float, high: float) -> "Spectra":
        """Return the bins from `low` to `high` [Hz]."""
        begin = int(np.searchsorted(self.f, low))
        bins = slice(begin, int(np.searchsorted(self.f, high, side="right")))
        f, columns, nuisance = self.f[bins], self.columns[bins], self.nuisance[bins]
        return replace(self, f=f, columns=columns, nuisance=nuisance, first=self.first + begin)

    def summed(self, c: Array) -> "Spectra":
        """Return the same with one column: the sum of the first K with the coefficients c, shape (K,)."""
        return replace(self, columns=(self.columns[:, : c.size] @ c)[:, None])

    def hstack(self, other: "Spectra") -> "Spectra":
        """Return the columns of both, which must be of one run."""
        return replace(self, columns=np.concatenate([self.columns, other.columns], axis=1))


def transform(
    columns: Array | Iterable[Array],
    valid: NDArray[np.bool_],
    fs: float,
    tau: tuple[float, float] = (0.0, 0.0),
    nuisance: Iterable[Array] = (),
    band: tuple[float, float] | None = None,
    gap_taper: float = GAP_TAPER,
) -> Spectra:
    """Window and transform columns, shape (N, P), of sample rate `fs`, expanded about the delays `tau`.

    Up to 0.5 % of the end of the run is left out, for a length that transforms fast.

    Parameters
    ----------
    columns : ndarray, shape (N, P), or iterable of ndarray
        The series, whole or in chunks of columns that are requested one by one to save memory.
    valid : ndarray of bool, shape (N,)
        False where samples are masked.
    fs : float
        Sample rate [Hz].
    tau : tuple of float
        Delays [s] about which the columns were expanded.
    nuisance : iterable of ndarray, shape (N, G) each
        Series to be projected out along with constant and ramp.
    band : tuple of float, optional
        Ends of the part of the fitted band to transform [Hz].
    gap_taper : float
        Flank of the window beside masked samples [s].
    """
    n = scipy.fft.prev_fast_len(valid.size)
    w, bins = window(valid[:n], fs, gap_taper=gap_taper), _bins(n, fs, band)
    if valid[:n].all():
        projected = [_unmasked_constant_and_ramp(n, fs, bins.start, bins.stop)]
    else:
        projected = [_constant_and_ramp(w, fs, bins)]
    projected += [windowed_spectra(chunk, w, fs, bins) for chunk in nuisance]
    f = np.arange(bins.start, bins.stop) * fs / n
    return Spectra(f, windowed_spectra(columns, w, fs, bins), np.hstack(projected), w, tau, bins.start)


def _constant_and_ramp(w: Array, fs: float, bins: slice) -> Spectrum:
    """Return constant and ramp under a window, shape (B, 2)."""
    return windowed_spectra(np.stack([np.ones(w.size), np.linspace(-1, 1, w.size)], axis=1), w, fs, bins)


@lru_cache(maxsize=8)
def _unmasked_constant_and_ramp(n: int, fs: float, start: int, end: int) -> Spectrum:
    """Return the same for a run without masks, at the bins from `start` on."""
    return _constant_and_ramp(_tukey(n, TAPER), fs, slice(start, end))


def windowed_spectra(
    columns: Array | Iterable[Array], w: Array, fs: float, bins: slice | None = None
) -> Spectrum:
    """Return the transforms of columns, shape (N or more, P) or in parts, under a window, see `Spectra`."""
    scale, bins = math.sqrt(2 / (fs * float(w @ w))), bins or _bins(w.size, fs)
    chunks = iter([columns] if isinstance(columns, np.ndarray) else columns)
    spectra: list[Spectrum] = []
    rows, filled = np.empty((2, w.size)), 0  # two at a time are faster, more fill the memory

    def transform_rows() -> None:
        spectra.append(scipy.fft.rfft(rows[:filled])[:, bins] * scale)

    for chunk in chunks:
        for k in range(chunk.shape[1]):
            np.multiply(chunk[: w.size, k], w, out=rows[filled])
            filled += 1
            if filled == len(rows):
                transform_rows()
                filled = 0
        del chunk  # free its memory
    transform_rows()  # the last one, if any
    return np.concatenate(spectra).T


def resample_window(w: Array, fs: float, rate: float) -> tuple[Array, float]:
    """Return a window at no fewer instants than make a sample rate, from the same begin on, and theirs [Hz].

    Under it the transform of a series that hardly changes between two of them has the bins it has under `w`.
    """
    m = min(scipy.fft.next_fast_len(math.ceil(w.size * rate / fs), real=True), w.size)
    return np.interp(np.arange(m) * (w.size / m), np.arange(w.size), w), fs * m / w.size


def inverse_transform(columns: Spectrum, start: int, n: int) -> Array:
    """Return the inverse transforms, shape (n, P), of columns that begin at the bin `start`."""
    series = np.empty((n, columns.shape[1]), order="F")
    for some in pieces(columns.shape[1], length=2):
        padded = np.zeros((columns[:, some].shape[1], n // 2 + 1), dtype=np.complex128)
        padded[:, start : start + len(columns)] = columns[:, some].T
        series[:, some] = scipy.fft.irfft(padded, n).T
    return series


def product_series(columns: Spectrum, start: int, window: Array) -> tuple[Array, Array]:
    """Return series whose products, summed with weights, are those of windowed white noise over a run.

    Columns of the fitted band change slowly: their products need fewer instants than the run has, and of the
    window no more than what varies as slowly as these.

    Parameters
    ----------
    columns : ndarray of complex, shape (B, P)
        Whitened; they begin at the bin `start`.
    start : int
        See `Spectra`.
    window : ndarray, shape (n,)
        Of the run.

    Returns
    -------
    series : ndarray, shape (m, P)
        Inverse transforms.
    weights : ndarray, shape (m,)
        Of their products.
    """
    n, stop = window.size, start + len(columns)
    m = min(scipy.fft.next_fast_len(4 * stop - 2, real=True), n)  # up to twice the last bin
    weights = _unmasked_weights(n, m, TAPER) if window is _tukey(n, TAPER) else _product_weights(window, m)
    return inverse_transform(columns, start, m), weights


def _product_weights(window: Array, m: int) -> Array:
    """Return the weights of `squared` for a window of a run, shape (m,)."""
    n, end = window.size, m // 2 + 1
    w2 = window * window
    squares = float(w2.sum())
    if m == n:
        return np.asarray(w2 * (n * m / 2 / squares))
    slow = scipy.fft.irfft(scipy.fft.rfft(w2)[:end], m) * (m / n)
    return np.asarray(slow * (n * m / 2 / squares))


@lru_cache(maxsize=8)
def _unmasked_weights(n: int, m: int, taper: float) -> Array:
    """Return the same for a run without masks."""
    weights = _product_weights(_tukey(n, taper), m)
    weights.setflags(write=False)  # cacheds
    return weights


def _bins(n: int, fs: float, band: tuple[float, float] | None = None) -> slice:
    """Return the bins of the fitted band, or of part of it [Hz], in the transform of `n` samples."""
    n_bins = math.floor(min(F_MAX, fs / 10) * n / fs)
    if band is None:
        return slice(1, n_bins + 1)
    f = np.arange(1, n_bins + 1) * fs / n
    return slice(1 + int(np.searchsorted(f, band[0])), 1 + int(np.searchsorted(f, band[1], side="right")))


def variance_factor(window: Array) -> float:
    """Return the variance of sums over bins under a window, relative to independent bins."""
    w2 = window * window
    return float(window.size * (w2 @ w2) / w2.sum() ** 2)
