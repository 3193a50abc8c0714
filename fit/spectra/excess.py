"""Excess: where a series is louder after something was subtracted from it.

Both are cut into segments of `SEGMENT`, windowed, and averaged over bands of a quarter of a decade. What is
subtracted and does not belong to the series raises its power by a share x, with a standard deviation of
sqrt((2 x + x^2) / N) for N independent ordinates in the band. An increase is an excess if it is larger than
`HARMLESS`, and than the budget of false alarms allows for as many tests as there are bands.
"""

import math
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import sigma_limit

Array = NDArray[np.float64]

SEGMENT = 40_000.0  # s: four ordinates below 0.1 mHz
PER_DECADE = 4
HARMLESS = 0.02  # of the power: 1 % of the amplitude
INDEPENDENT = 0.5  # share of the ordinates that count as independent under a Hann window
MAX_MISSING = 0.5  # share of samples that a segment may miss; both series are bridged there alike
MIN_ORDINATES = 4  # ordinates in a band


class Excess:
    """Compares two series block by block, in memory that does not grow with them.

    Parameters
    ----------
    size : int
        Samples of either series.
    fs : float
        Sample rate [Hz].
    """

    def __init__(self, size: int, fs: float) -> None:
        self._n, self._fs = min(round(SEGMENT * fs), size), fs
        self._rest: Array = np.empty((0, 2))
        self._power, self._segments = np.zeros((self._n // 2 + 1, 3)), 0.0

    def add(self, original: Array, corrected: Array) -> None:
        """Take the next samples of both, NaN where they are missing."""
        self._rest = np.concatenate([self._rest, np.stack([original, corrected], axis=1)])
        while len(self._rest) >= self._n > 1:
            segment, self._rest = self._rest[: self._n], self._rest[self._n :]
            valid = np.isfinite(segment).all(axis=1)
            if np.mean(valid) >= 1 - MAX_MISSING:
                index = np.arange(self._n)
                bridged = np.stack([np.interp(index, index[valid], x[valid]) for x in segment.T], axis=1)
                self._segments += float(np.mean(valid))
                self._measure(np.column_stack([bridged, bridged[:, 1] - bridged[:, 0]]))

    @property
    def compared(self) -> bool:
        """Whether there was a segment to compare the two in."""
        return self._segments > 0

    def _measure(self, series: Array) -> None:
        window = scipy.signal.windows.hann(self._n, sym=False)
        spectra = scipy.fft.rfft(scipy.signal.detrend(series, axis=0) * window[:, None], axis=0)
        self._power += np.abs(spectra) ** 2

    def bands(self) -> list[tuple[float, float, float]]:
        """Return the ends of bands [Hz] in which the second is louder, and the ratio of amplitudes there."""
        f = np.arange(len(self._power)) * self._fs / self._n
        lowest = math.floor(PER_DECADE * math.log10(2 / (self._n / self._fs)))
        highest = math.ceil(PER_DECADE * math.log10(self._fs / 2))
        edges = 10.0 ** (np.arange(lowest, highest + 1) / PER_DECADE)
        limit = sigma_limit(edges.size - 1)
        excesses: list[tuple[float, float, float]] = []
        for low, high in pairwise(edges):
            inside = (f >= max(low, 1.5 * f[1])) & (f < high)
            original, corrected, correction = self._power[inside].sum(axis=0)
            if inside.sum() < MIN_ORDINATES or not original > 0:
                continue
            x, N = correction / original, INDEPENDENT * self._segments * inside.sum()
            if corrected / original - 1 > max(limit * math.sqrt((2 * x + x * x) / N), HARMLESS):
                ratio = math.sqrt(corrected / original)
                if excesses and excesses[-1][1] == low:
                    low, ratio = excesses[-1][0], max(excesses.pop()[2], ratio)
                excesses.append((float(low), float(high), ratio))
        return excesses
