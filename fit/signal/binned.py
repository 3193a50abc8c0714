"""Amplitude spectral densities of whole runs, averaged over logarithmic bins, with error bars.

The window and its notches at missing samples are those of the fit, so that a curve shows what the fit saw.
A tone keeps its narrow peak: bins are split at ordinates that chance does not explain. (`logpsd` gives
every frequency segments of its own instead: the better estimate of a smooth spectrum, but tones as wide as
a segment resolves.)
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.signal import spectra

Array = NDArray[np.float64]

BINS_PER_DECADE = 24
CHANCE = 1e-5  # that noise splits a bin
BESIDE = 2  # ordinates on either side of a peak that stand alone: the window spreads it over them
CORRELATED = 50  # ordinates apart, beyond which the window correlates none
ONE_SIGMA = (0.8413, 0.1587)


@dataclass(frozen=True)
class Binned:
    """One-sided ASD.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Mean frequency of every bin [Hz].
    asd : ndarray, shape (B,)
        Root of the mean power, unit of the series per root Hz.
    low, high : ndarray, shape (B,)
        Bounds of the central 68.3 % interval of the true ASD, were the series Gaussian noise.
    """

    f: Array
    asd: Array
    low: Array
    high: Array


class Estimator:
    """What the series of one run have in common: window, frequencies, what is missing.

    Parameters
    ----------
    valid : ndarray of bool, shape (N,)
        False where samples are missing.
    fs : float
        Sample rate [Hz].
    highest : float
        Frequency up to which to go [Hz].
    """

    def __init__(self, valid: NDArray[np.bool_], fs: float, highest: float) -> None:
        n = scipy.fft.prev_fast_len(valid.size)  # the fit leaves out the same
        self._valid = valid[:n]
        self._window = spectra.window(self._valid, fs)
        w2 = self._window**2
        self._scale = 2 / (fs * float(w2.sum()))
        self._f = np.arange(1, min(math.floor(highest * n / fs), (n - 1) // 2) + 1) * fs / n
        spectrum = scipy.fft.rfft(w2)[: CORRELATED + 1]
        self._correlation = np.abs(spectrum) ** 2 / float(w2.sum()) ** 2

    def asd(self, values: Array) -> Binned:
        """Return the ASD of a series, shape (N,), less mean and slope; what is not valid may be anything."""
        x = np.where(self._valid, values[: self._valid.size], 0.0)
        u = np.where(self._valid, np.linspace(-1, 1, x.size), 0.0)
        u -= self._valid * (u.sum() / np.count_nonzero(self._valid))
        x -= self._valid * (x.sum() / np.count_nonzero(self._valid))
        x -= u * float(np.sum(u * x)) / float(np.sum(u * u))  # no @: its last bits depend on threads
        power = np.abs(scipy.fft.rfft(self._window * x)[1 : self._f.size + 1]) ** 2 * self._scale
        starts = _starts(self._f, power)
        count = np.diff(starts, append=power.size)
        mean = np.add.reduceat(power, starts) / count
        dof = self._degrees_of_freedom(count)
        low, high = (np.sqrt(mean * dof / scipy.stats.chi2.ppf(p, dof)) for p in ONE_SIGMA)
        return Binned(np.add.reduceat(self._f, starts) / count, np.sqrt(mean), low, high)

    def _degrees_of_freedom(self, count: NDArray[np.intp]) -> Array:
        """Return those of the mean of `count` neighbouring ordinates, which the window makes one noise."""
        apart = np.arange(1, self._correlation.size)
        pairs = np.maximum(count[:, None] - apart, 0) @ self._correlation[1:]
        return np.asarray(2 * count**2 / (count + 2 * pairs), dtype=np.float64)


def _starts(f: Array, power: Array) -> NDArray[np.intp]:
    """Return the first ordinate of every bin."""
    starts = np.flatnonzero(np.diff(np.floor(BINS_PER_DECADE * np.log10(f)), prepend=-np.inf))
    more: list[int] = []
    for begin, end in zip(starts, [*starts[1:], f.size], strict=True):
        ordinates, n = power[begin:end], end - begin
        # noise has exponentially distributed ordinates, whose median knows nothing of a few large ones
        if n > 4 * BESIDE and ordinates.max() > np.median(ordinates) / math.log(2) * math.log(n / CHANCE):
            peak = begin + int(np.argmax(ordinates))
            more += range(max(begin, peak - BESIDE), min(end, peak + BESIDE + 2))
    return np.union1d(starts, np.array([s for s in more if s < f.size], dtype=starts.dtype))
