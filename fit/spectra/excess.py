"""Where a series that something was subtracted from is louder than before.

Both are cut into segments of `SEGMENT`, windowed, and averaged over bands of a quarter of a decade. What is
subtracted and has nothing to do with the series raises its power by a share x, give or take
sqrt((2 x + x^2) / N) with N independent ordinates in the band. An increase of more than `SURE` times that,
and of more than `HARMLESS`, is told.
"""

import math
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEGMENT = 40_000.0  # s: four ordinates below 0.1 mHz
PER_DECADE = 4
SURE = 2.0  # sigma
HARMLESS = 0.02  # of the power: 1 % of the amplitude
INDEPENDENT = 0.5  # share of the ordinates that count as independent under a Hann window
MISSING = 0.5  # share of samples that a segment may miss; both series are bridged there alike
FEWEST = 4  # ordinates in a band


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

    def add(self, before: Array, after: Array) -> None:
        """Take the next samples of both, NaN where they are missing."""
        self._rest = np.concatenate([self._rest, np.stack([before, after], axis=1)])
        while len(self._rest) >= self._n > 1:
            segment, self._rest = self._rest[: self._n], self._rest[self._n :]
            there = np.isfinite(segment).all(axis=1)
            if np.mean(there) >= 1 - MISSING:
                at = np.arange(self._n)
                whole = np.stack([np.interp(at, at[there], x[there]) for x in segment.T], axis=1)
                self._segments += float(np.mean(there))
                self._measure(np.column_stack([whole, whole[:, 1] - whole[:, 0]]))

    @property
    def compared(self) -> bool:
        """Whether there was a segment to compare the two in."""
        return self._segments > 0

    def _measure(self, series: Array) -> None:
        window = scipy.signal.windows.hann(self._n, sym=False)
        found = scipy.fft.rfft(scipy.signal.detrend(series, axis=0) * window[:, None], axis=0)
        self._power += np.abs(found) ** 2

    def bands(self) -> list[tuple[float, float, float]]:
        """Return the ends of bands [Hz] in which the second is louder, and the ratio of amplitudes there."""
        f = np.arange(len(self._power)) * self._fs / self._n
        first = math.floor(PER_DECADE * math.log10(2 / (self._n / self._fs)))
        last = math.ceil(PER_DECADE * math.log10(self._fs / 2))
        edges = 10.0 ** (np.arange(first, last + 1) / PER_DECADE)
        found: list[tuple[float, float, float]] = []
        for low, high in pairwise(edges):
            inside = (f >= max(low, 1.5 * f[1])) & (f < high)
            before, after, taken = self._power[inside].sum(axis=0)
            if inside.sum() < FEWEST or not before > 0:
                continue
            x, N = taken / before, INDEPENDENT * self._segments * inside.sum()
            if after / before - 1 > max(SURE * math.sqrt((2 * x + x * x) / N), HARMLESS):
                ratio = math.sqrt(after / before)
                if found and found[-1][1] == low:
                    low, ratio = found[-1][0], max(found.pop()[2], ratio)
                found.append((float(low), float(high), ratio))
        return found
