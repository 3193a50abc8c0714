"""Scans over what locates an effect in a run: a lag, the ends of a segment, an onset, a frequency.

Lags and onsets come from a cross-correlation by FFT, segments from cumulative sums of products of whitened
series, since a step hardly cares whether it comes before or after whitening.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.spectra import Spectra, windowing

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

MAX_LAG = 300.0  # s
LAG_OVERSAMPLING = 4  # lags per sample
SEGMENT_STEP, MAX_STEPS = 60.0, 400  # s between possible ends of a segment, and their number
MARGIN = 0.03  # share of a run at either end, where the window hides whether a segment ends
MIN_PERIODS = 4  # in a run; a slower sine is a drift
FREQUENCY_STEPS = (0.25, 0.05, 0.01)  # of a bin


@dataclass(frozen=True)
class Segment:
    """Part of a run; infinite ends where the run begins or ends.

    Attributes
    ----------
    begin, end : float
        Seconds since the start of the run.
    delta_chi2 : float
        By how much chi^2 falls with the effect in that part alone.
    """

    begin: float
    end: float
    delta_chi2: float = 0.0

    @property
    def edges(self) -> tuple[float, ...]:
        """Ends that are not those of the run."""
        return tuple(edge for edge in (self.begin, self.end) if np.isfinite(edge))

    @property
    def words(self) -> str:
        """Where it lies."""
        if not np.isfinite(self.begin):
            return f"until {self.end:.0f} s"
        return f"from {self.begin:.0f} s on" + f" until {self.end:.0f} s" * bool(np.isfinite(self.end))

    def contains(self, time: Array) -> NDArray[np.bool_]:
        """Return which instants [s] lie in it."""
        return (time >= self.begin) & (time < self.end)


def as_complex(column: Array) -> Complex:
    """Return a column of real and imaginary parts in turn, shape (2 B,), as complex numbers, shape (B,)."""
    return np.ascontiguousarray(column).view(np.complex128)


def cross_correlation(column: Complex, residual: Complex, spectra: Spectra, n: int) -> Array:
    """Return the product of a residual with a column at every lag, n lags over the run, shape (n,)."""
    padded = np.zeros(n // 2 + 1, dtype=np.complex128)
    padded[spectra.bins] = residual.conj() * column
    return np.asarray(scipy.fft.irfft(padded, n) * n / 2)


def scan_lag(
    column: Array, residual: Array, spectra: Spectra, fs: float, *, scaled: bool
) -> tuple[float, float]:
    """Return lag [s] and scale of a whitened column, shape (2 B,), that cancel a residual best.

    Parameters
    ----------
    column, residual : ndarray, shape (2 B,)
        Whitened channel, and the residual without that channel.
    spectra : Spectra
        Of the run.
    fs : float
        Sample rate [Hz].
    scaled : bool
        Whether the scale is free; 1 otherwise.
    """
    samples = spectra.window.size
    n = LAG_OVERSAMPLING * samples
    lags = scipy.fft.fftfreq(n, 1 / n) / (fs * LAG_OVERSAMPLING)
    allowed = np.abs(lags) < min(MAX_LAG, 0.05 * samples / fs)
    product = cross_correlation(as_complex(column), as_complex(residual), spectra, n)[allowed]
    i = int(np.argmin(-(product**2) if scaled else product))
    return float(lags[allowed][i]), -float(product[i]) / float(column @ column) if scaled else 1.0


def scan_segment(column: Array, residual: Array, spectra: Spectra, time: Array, *, fixed: bool) -> Segment:
    """Return the part of a run in which an effect explains most.

    Parameters
    ----------
    column, residual : ndarray, shape (2 B,)
        Whitened effect in all of the run, and residual.
    spectra : Spectra
        Of the run.
    time : ndarray, shape (M,)
        Of its columns [s].
    fixed : bool
        Whether the amount of the effect is one; free otherwise.
    """
    n = spectra.window.size
    both = np.stack([as_complex(column), as_complex(residual)], axis=1)
    effect, r = windowing.inverse_transform(both, spectra.first, n).T * np.sqrt(n / 2)
    size = max(round(SEGMENT_STEP * n / (time[-1] - time[0])), -(-n // MAX_STEPS))
    starts = np.arange(0, n, size)
    sums = (np.concatenate([[0.0], np.cumsum(np.add.reduceat(x, starts))]) for x in (effect**2, effect * r))
    power, product = (x[None, :] - x[:, None] for x in sums)
    if fixed:
        gain = 2 * product - power
    else:
        present = power > 1e-6 * np.sum(effect**2)
        gain = np.where(present, product**2 / np.where(present, power, 1.0), 0.0)
    gain[np.tril_indices(len(gain))] = 0.0
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    margin = MARGIN * len(starts)
    begin = -np.inf if i < margin else float(time[starts[i]])
    end = np.inf if j > len(starts) - margin else float(time[starts[j]])
    return Segment(begin, end, float(gain[i, j]))


def refine_segment(segment: Segment, delta_chi2: Callable[[Segment], float]) -> Segment:
    """Move the ends of a segment to the second at which an effect explains most."""

    def move(begin_shift: float, end_shift: float) -> Segment:
        shifted = Segment(segment.begin + begin_shift, segment.end + end_shift)
        return Segment(shifted.begin, shifted.end, delta_chi2(shifted))

    segment = move(0.0, 0.0)
    for step in (30.0, 8.0, 2.0, 1.0):
        shifts = step * np.arange(-4, 5)
        if np.isfinite(segment.begin):
            segment = max((segment, *(move(s, 0.0) for s in shifts)), key=lambda s: s.delta_chi2)
        if np.isfinite(segment.end):
            segment = max((segment, *(move(0.0, s) for s in shifts)), key=lambda s: s.delta_chi2)
    return segment


def scan_onset(column: Array, residual: Array, spectra: Spectra, time: Array) -> float:
    """Return when [s] a step stands out most, given its whitened column, (2 B,), in the middle of the run."""
    n = spectra.window.size
    product = cross_correlation(as_complex(residual), as_complex(column), spectra, n)
    i = int(np.argmax(np.roll(np.abs(product), n // 2) * (spectra.window > 0.1)))
    return float(time[i])


def scan_frequency(residual: Array, spectra: Spectra, delta_chi2: Callable[[float], float]) -> float:
    """Return the frequency [Hz] of the sine that explains most of a residual, shape (2 B,)."""
    width = float(spectra.f[1] - spectra.f[0])
    power = np.abs(as_complex(residual)) ** 2
    f = float(spectra.f[np.argmax(np.where(spectra.f < MIN_PERIODS * width, 0.0, power))])
    for step in FREQUENCY_STEPS:
        f = max((f + step * k * width for k in range(-4, 5)), key=delta_chi2)
    return f
