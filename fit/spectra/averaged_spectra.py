"""Averaged spectra with error bars, in two ways.

`Estimator` averages over logarithmic bins of the transform of a whole run. Window and notches at missing
samples are those of the fit, so that a curve shows what the fit saw. A tone keeps its narrow peak: bins are
split at ordinates that chance does not explain.

`log_psd` gives every frequency segments of its own, as LPSD does (Tröbs and Heinzel, Measurement 39, 2006),
here `PERIODS` of its periods long. High frequencies are averaged over many short segments, low ones keep
their resolution. It is the better estimate of a smooth spectrum, but tones are as wide as a segment resolves.
SpecKit, the field's own package, does the same; for the few curves of a report this page stands in for it and
the 200 MB of compiler that it brings.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from fit.errors import InputError, shown
from fit.parallel import parallel_map
from fit.requirements import GAP_TAPER, STEEP_GAP_TAPER, TAPER
from fit.spectra.windowing import window

Array = NDArray[np.float64]

ONE_SIGMA = (0.8413, 0.1587)
# of `Estimator`
BINS_PER_DECADE = 24
P_SPLIT = 1e-5  # that noise splits a bin
PEAK_REACH = 2  # ordinates on either side of a peak that stand alone: the window spreads it over them
CORRELATED = 50  # ordinates apart, beyond which the window correlates none
# of `log_psd`
PER_DECADE = 10
PERIODS = PER_DECADE / np.log(10)  # per segment: neighbouring frequencies are one resolution apart
SHARE = 0.5  # of the longest series that a segment may take: three of them, half overlapping
_NOTHING = (math.nan, math.nan, 0.0)


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
    rising_noise : bool
        Whether the noise rises steeply with frequency. A Hann window then replaces the Tukey window, whose
        sidelobes carry noise to the lowest frequencies, with wider flanks beside missing samples. Mean and
        slope are fitted to the windowed series, because the ends of a run determine those of the series.
    """

    def __init__(
        self, valid: NDArray[np.bool_], fs: float, highest: float, *, rising_noise: bool = False
    ) -> None:
        n = scipy.fft.prev_fast_len(valid.size)  # the fit leaves out the same
        self._valid = valid[:n]
        flanks = (1.0, STEEP_GAP_TAPER) if rising_noise else (TAPER, GAP_TAPER)
        self._window = window(self._valid, fs, *flanks)
        w2 = self._window**2
        self._scale = 2 / (fs * float(w2.sum()))
        spectrum = scipy.fft.rfft(w2)[: CORRELATED + 1].copy()  # of all of it, the memory would be full
        self._correlation = np.abs(spectrum) ** 2 / float(w2.sum()) ** 2
        del w2
        self._ramp = np.linspace(-1, 1, n)
        self._ramp[~self._valid] = 0.0
        mean = self._ramp.sum() / np.count_nonzero(self._valid)
        np.subtract(self._ramp, mean, out=self._ramp, where=self._valid)
        self._trend = None
        if rising_noise:
            self._trend = np.stack([self._window, self._window * np.linspace(-1, 1, n)], axis=1)
        self._f = np.arange(1, min(math.floor(highest * n / fs), (n - 1) // 2) + 1) * fs / n

    def asd(self, values: Array) -> Binned:
        """Return the ASD of a series, shape (N,), less mean and slope; what is not valid may be anything."""
        return self.binned(self.power(values))

    def binned(self, power: Array, stretches: int = 1) -> Binned:
        """Return the ASD of a periodogram, or the mean of those of so many stretches of a run."""
        starts = _starts(self._f, power)
        count = np.diff(starts, append=power.size)
        mean = np.add.reduceat(power, starts) / count
        dof = self._degrees_of_freedom(count) * stretches
        low, high = (np.sqrt(mean * dof / scipy.special.chdtri(dof, 1 - p)) for p in ONE_SIGMA)
        return Binned(np.add.reduceat(self._f, starts) / count, np.sqrt(mean), low, high)

    def power(self, values: Array) -> Array:
        """Return the periodogram of a series, shape (N,), less mean and slope."""
        x = np.where(self._valid, values[: self._valid.size], 0.0)
        u = self._ramp
        np.subtract(x, x.sum() / np.count_nonzero(self._valid), out=x, where=self._valid)
        x -= u * float(np.sum(u * x)) / float(np.sum(u * u))  # no @: its last bits depend on threads
        windowed = self._window * x
        if self._trend is not None:
            windowed -= self._trend @ np.linalg.lstsq(self._trend, windowed)[0]
        spectrum = scipy.fft.rfft(windowed)[1 : self._f.size + 1]
        return np.asarray(np.abs(spectrum) ** 2 * self._scale, dtype=np.float64)

    def _degrees_of_freedom(self, count: NDArray[np.intp]) -> Array:
        """Return those of the mean of `count` neighbouring ordinates, which the window makes one noise."""
        lags = np.arange(1, self._correlation.size)
        pairs = np.maximum(count[:, None] - lags, 0) @ self._correlation[1:]
        return np.asarray(2 * count**2 / (count + 2 * pairs), dtype=np.float64)


def _starts(f: Array, power: Array) -> NDArray[np.intp]:
    """Return the first ordinate of every bin."""
    starts = np.flatnonzero(np.diff(np.floor(BINS_PER_DECADE * np.log10(f)), prepend=-np.inf))
    ends = np.append(starts[1:], f.size)
    n = ends - starts
    # noise has exponentially distributed ordinates, whose median knows nothing of a few large ones
    limits = np.maximum.reduceat(power, starts) * math.log(2) / np.log(n / P_SPLIT)
    small = np.add.reduceat(power < np.repeat(limits, n), starts, dtype=np.intp)
    peak_bins: list[int] = []
    for i in np.flatnonzero((n > 4 * PEAK_REACH) & (2 * small >= n)):
        ordinates = power[starts[i] : ends[i]]
        if np.median(ordinates) < limits[i]:
            peak = starts[i] + int(np.argmax(ordinates))
            peak_bins += range(max(starts[i], peak - PEAK_REACH), min(ends[i], peak + PEAK_REACH + 2))
    return np.union1d(starts, np.array([s for s in peak_bins if s < f.size], dtype=starts.dtype))


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


class Asd(NamedTuple):
    """One-sided ASD: frequencies [Hz], ASD in the unit of the series per root Hz, its standard error."""

    f: Array
    asd: Array
    sigma: Array


def asd(x: ArrayLike, fs: float) -> Asd:
    """Return the ASD of a series, by the spectral estimator of the report (`log_psd`).

    Parameters
    ----------
    x : array_like, shape (N,)
        Missing samples are NaN.
    fs : float
        Sample rate [Hz].

    Returns
    -------
    f, asd, sigma : ndarray, shape (B,)
        Frequencies [Hz], ten per decade; ASD in the unit of `x` per root Hz; standard error of the ASD.

    Raises
    ------
    InputError
        If `x` is no series of real numbers or too short, or `fs` is not a positive number.
    """
    try:
        series = np.asarray(x)
        series = series.astype(np.float64) if series.dtype.kind in "iuf" else np.empty((0, 0))
        rate = float(fs)
    except (TypeError, ValueError):
        raise InputError(f"asd: {shown(fs)}: expected a series of numbers and its sample rate") from None
    if series.ndim != 1 or np.isinf(series).any():
        raise InputError("asd: x: expected one series of finite real numbers, NaN where samples are missing")
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(f"asd: fs: {shown(fs)}, expected a positive sample rate in Hz")
    min_samples = math.ceil(PERIODS / SHARE * 2 * (1 + 2 / PERIODS))
    if np.count_nonzero(np.isfinite(series)) < min_samples:
        raise InputError(f"asd: x: fewer than {min_samples} samples")
    spectrum = log_psd([series], rate)
    if not spectrum.f.size:
        raise InputError("asd: x: no stretch without missing samples is long enough")
    root = np.sqrt(spectrum.psd)
    return Asd(spectrum.f, root, root / (2 * np.sqrt(spectrum.averages)))


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
    return log_psds([series], fs)[0]


def log_psds(quantities: Sequence[Sequence[Array]], fs: float) -> list[LogSpectrum]:
    """Return the PSD of every quantity of the same runs: `log_psd` of its series, segments laid out once."""
    longest = max(x.size for series in quantities for x in series)
    lowest, highest = PERIODS * fs / (SHARE * longest), fs / 2 / (1 + 2 / PERIODS)
    steps = np.arange(max(0.0, np.floor(PER_DECADE * np.log10(highest / lowest)) + 1))

    def psd(f: float) -> list[tuple[float, float, float]]:
        L = min(round(PERIODS * fs / f), longest)
        kernel, overlap = _kernel(f / fs, L)
        rows = []
        for series in quantities:
            power = np.concatenate([_power(x, kernel, L) for x in series])
            power = power[np.isfinite(power)]
            n = power.size
            rows.append((f, power.mean() * 2 / fs, n / (1 + 2 * overlap * (1 - 1 / n))) if n else _NOTHING)
        return rows

    every = np.array(parallel_map(psd, lowest * 10 ** (steps / PER_DECADE))).reshape(-1, len(quantities), 3)
    return [_with_bounds(*points[points[:, 2] > 0].T) for points in every.swapaxes(0, 1)]


def _with_bounds(f: Array, psd: Array, averages: Array) -> LogSpectrum:
    low, high = (psd * 2 * averages / scipy.special.chdtri(2 * averages, 1 - p) for p in ONE_SIGMA)
    return LogSpectrum(f, psd, low, high, averages)


def _kernel(cycles: float, size: int) -> tuple[NDArray[np.complex128], float]:
    """Return what a segment is multiplied by, and the correlation of the power of half-overlapping segments.

    To take the straight line out of the kernel is to take it out of every segment.
    """
    w = np.asarray(scipy.signal.windows.hann(size, sym=False), dtype=np.float64)
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
    step = max(1, size // 2)
    n = (x.size - size) // step + 1
    halves = x[: (n + 1) * step].reshape(n + 1, step)  # a segment is two of them, and a sample if it is odd
    power = np.zeros(n)
    for part in (kernel.real.copy(), kernel.imag.copy()):
        amplitude = halves[:-1] @ part[:step] + halves[1:] @ part[step : 2 * step]
        if size % 2:
            amplitude += x[2 * step :: step][:n] * part[-1]
        power += amplitude**2
    return power
