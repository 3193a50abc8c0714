"""Spectra averaged evenly on a logarithmic scale, with error bars.

As in LPSD (Tröbs and Heinzel, Measurement 39, 2006): every frequency has segments of its own length, here
`PERIODS` of its periods, so that high frequencies are averaged over many short segments and low ones keep
their resolution. SpecKit, the field's own package, does the same; for the few curves of a report this page
stands in for it and the 200 MB of compiler that it brings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

Array = NDArray[np.float64]

PER_DECADE = 10
PERIODS = PER_DECADE / np.log(10)  # per segment: neighbouring frequencies are one resolution apart
SHARE = 0.5  # of the longest series that a segment may take: three of them, half overlapping


@dataclass(frozen=True)
class LogSpectrum:
    """One-sided PSD.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz], evenly spaced in log f.
    psd : ndarray, shape (B,)
        Unit of the series squared per Hz.
    low, high : ndarray, shape (B,)
        Bounds of the central 68.3 % interval of the true PSD.
    averages : ndarray, shape (B,)
        Independent averages each estimate is worth.
    """

    f: Array
    psd: Array
    low: Array
    high: Array
    averages: Array


def log_psd(series: Sequence[Array], fs: float) -> LogSpectrum:
    """Return the PSD of one or several series that share one spectrum.

    Segments overlap by half, lose their mean and slope, and are left out where samples are missing.

    Parameters
    ----------
    series : sequence of ndarray
        Missing samples are NaN; shape (N_i,) each.
    fs : float
        Sample rate [Hz].
    """
    longest = max(x.size for x in series)
    lowest, highest = PERIODS * fs / (SHARE * longest), fs / 2 / (1 + 2 / PERIODS)
    steps = np.arange(max(0.0, np.floor(PER_DECADE * np.log10(highest / lowest)) + 1))
    found = []
    for f in lowest * 10 ** (steps / PER_DECADE):
        L = min(round(PERIODS * fs / f), longest)
        kernel, overlap = _kernel(f / fs, L)
        power = np.concatenate([_power(x, kernel, L) for x in series])
        power = power[np.isfinite(power)]
        if power.size:
            found.append((f, power.mean() * 2 / fs, power.size / (1 + 2 * overlap * (1 - 1 / power.size))))
    f, psd, averages = np.array(found).reshape(-1, 3).T
    low, high = (psd * 2 * averages / scipy.stats.chi2.ppf(p, 2 * averages) for p in (0.8413, 0.1587))
    return LogSpectrum(f, psd, low, high, averages)


def _kernel(cycles: float, size: int) -> tuple[NDArray[np.complex128], float]:
    """Return what a segment is multiplied by, and the correlation of the power of half-overlapping segments.

    To take the straight line out of the kernel is to take it out of every segment.
    """
    w = scipy.signal.windows.hann(size, sym=False)
    n = np.arange(size)
    kernel = w * np.exp(-2j * np.pi * cycles * n)
    line = np.linalg.qr(np.stack([np.ones(size), n - n.mean()], axis=1))[0]
    kernel = kernel - line @ (line.T @ kernel)
    half = size // 2
    overlap = float(w[half:] @ w[: size - half] / (w @ w)) ** 2
    return np.asarray(kernel / np.sqrt(w @ w), dtype=np.complex128), overlap


def _power(x: Array, kernel: NDArray[np.complex128], size: int) -> Array:
    """Return the power of every segment, NaN where a sample is missing."""
    if x.size < size:
        return np.zeros(0)
    segments = sliding_window_view(x, size)[:: max(1, size // 2)]
    return np.asarray((segments @ kernel.real) ** 2 + (segments @ kernel.imag) ** 2, dtype=np.float64)
