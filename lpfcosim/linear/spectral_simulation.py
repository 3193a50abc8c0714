"""Telemetry of a run at 1 Hz without stepping it: the response to the injections, and noise from its spectra.

For the linear closed loop this is what the FMUs simulate, in distribution, at a tenth of the samples and
without a step; glitches and gaps are the same. The noise is stationary, where a simulation starts at the
equilibrium, and ends at 0.25 Hz; commands have no limit, and of the whole spacecraft's quadratic terms there
is what is linear about the steady turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.linear import response
from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.models import ELECTRODES, model_of, stimuli
from lpfcosim.signals import decimation, events
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Hz, end of the noise, and no more than this quarter, see `record`. An archive has noise beyond it, which
# moves estimates by some 1e-5 sigma.
HIGHEST = response.RATE / 4
GRID = 50  # frequencies per decade between which the noise is interpolated: right to 1e-5
FINER = 24  # chords between two of them, right to 1e-5 as well
BLOCK = 8192  # bins held at a time
# Channels that are transformed at a time: more of them would fill the memory.
BATCH = 2
RANK_TOLERANCE = 1e-6  # share of its noise that a channel has similar others, below which it depends on them
# Lengths of a run after which its noise repeats. Of noise that rises as 1/f, without constant and ramp, the
# lowest bin of the run has its power to 2e-3 then, and every other one to 5e-4.
PERIOD = 2


class Simulation:
    """A run that is to be drawn many times.

    Parameters
    ----------
    run : Run
        Its own seed counts for its glitches and gaps alone.
    channels : sequence of str
        C outputs of the models.
    similar : Simulation, optional
        Of a run with the same channels. What the same loop and noise, or the same length, give is reused.
    """

    def __init__(self, run: Run, channels: Sequence[str], similar: "Simulation | None" = None) -> None:
        glitches = None
        if events.glitches(run):  # the same in every draw
            glitches = stimuli.noise_source(replace(run, noise={}))
        self._n = run.n_samples // round(run.fs / response.RATE)
        driven = run.injections or glitches
        self._mean = (
            response.linear_response(run, glitches, channels=channels, low_pass=True)
            if driven
            else {name: np.zeros(self._n) for name in channels}
        )
        for name, level in ClosedLoop(run).equilibrium().items():
            if name in self._mean:
                self._mean[name] += level
        for set_point, rate in model_of(run).attitude_rates(run).items():
            follows = set_point.replace("attitude", "ast")
            if follows in self._mean:
                self._mean[follows] += rate * np.arange(self._n) / response.RATE
        self._lost = events.missing(run, np.arange(self._n) / response.RATE)
        self._bins: tuple[int, Array, Complex] = (
            similar._bins if similar and similar._n == self._n else _bins(self._n)
        )
        self._half, self._log_f, self._later = self._bins
        decade = int(np.floor(self._log_f[0] / np.log(10)))
        self._of_noise = _noise_of(run), decade
        if similar and similar._of_noise == self._of_noise:
            self._factor: SpectralFactor = similar._factor
        else:
            self._factor = _factor(run, channels, decade)

    def record(self, generator: np.random.Generator) -> dict[str, Array]:
        """Return telemetry at 1 Hz, low-passed as archives are, with noise that `generator` draws.

        Returns
        -------
        dict of str to ndarray, shape (n_samples / 10,)
            The channels, SI.
        """
        C, order, independent = len(self._mean), self._factor.order, self._factor.independent
        spectrum = np.zeros((C, self._later.size), dtype=np.complex128)
        inside = spectrum[:, 1 : self._log_f.size + 1]
        for begin in range(0, self._log_f.size, BLOCK):
            block = slice(begin, begin + BLOCK)
            L = self._factor.interpolator(self._log_f[block])
            drawn = generator.standard_normal((independent, L.shape[1], 2)).view(np.complex128)[:, :, 0]
            for (i, j), of_bins in zip(_lower(C, independent), L, strict=True):
                of_bins *= drawn[j]
                inside[order[i], block] += of_bins
        spectrum *= np.sqrt(2 * self._half * response.RATE) / 4
        series = np.empty((C, self._n))
        # As nothing lies above HIGHEST, every second sample is a series by itself; long ones are faster so.
        even = -(-self._n // 2)
        for i in range(0, C, BATCH):  # faster than one by one
            rows = spectrum[i : i + BATCH]
            series[i : i + BATCH, ::2] = scipy.fft.irfft(rows, self._half)[:, :even]
            rows *= self._later
            series[i : i + BATCH, 1::2] = scipy.fft.irfft(rows, self._half)[:, : self._n - even]
        for x, mean in zip(series, self._mean.values(), strict=True):
            x += mean
        series[:, self._lost] = np.nan
        return dict(zip(self._mean, series, strict=True))


class UniformInterpolator:
    """Chords of splines of several functions on evenly spaced knots: what looks up every place takes longer.

    Parameters
    ----------
    knots : ndarray, shape (K,)
        Evenly spaced.
    values : ndarray of complex, shape (K, S)
        There.
    """

    def __init__(self, knots: Array, values: Complex) -> None:
        fine = np.linspace(knots[0], knots[-1], FINER * (knots.size - 1) + 1)
        self._first, self._step = fine[0], (fine[-1] - fine[0]) / (fine.size - 1)
        self._values = np.ascontiguousarray(scipy.interpolate.CubicSpline(knots, values)(fine).T)
        self._slopes = np.diff(self._values) / self._step

    def __call__(self, x: Array) -> Complex:
        """Return the values at `x`, ascending, shape (S, N)."""
        cell = np.clip(((x - self._first) / self._step).astype(np.intp), 0, self._slopes.shape[1] - 1)
        offset = (x - (self._first + self._step * cell)).astype(np.complex128)  # once, not for every product
        sums = np.empty((len(self._values), x.size), dtype=np.complex128)
        for row, values, slopes in zip(sums, self._values, self._slopes, strict=True):
            np.multiply(slopes.take(cell), offset, out=row)
            row += values.take(cell)
        return sums


@dataclass(frozen=True)
class SpectralFactor:
    """The noise of C channels: products of a lower triangle L with its own adjoint are cross-spectra.

    Attributes
    ----------
    order : tuple of int
        Which channels its rows are.
    independent : int
        How many of its columns are not zero: the channels after these depend on those before.
    interpolator : UniformInterpolator
        The entries by log f, as `_lower` has them, low-passed; the cross-spectra are one-sided.
    """

    order: tuple[int, ...]
    independent: int
    interpolator: UniformInterpolator


def _lower(C: int, independent: int) -> list[tuple[int, int]]:
    """Return the places of a lower triangle, shape (C, independent)."""
    return [(i, j) for i in range(C) for j in range(min(i + 1, independent))]


def _noise_of(run: Run) -> Run:
    """Return what the noise of a run depends on."""
    noise_run = replace(run, name="", experiment="", kind="noise", t0="", seed=0, events=None)
    if any(map(run.level, ELECTRODES)):
        return noise_run  # it is as loud as the commands
    return replace(noise_run, injections=(), n_samples=1)


def _bins(n: int) -> tuple[int, Array, Complex]:
    """Return half of the samples in which noise of a run of n repeats, log f of its bins, and how they turn.

    The last are factors from one sample to the next, that of the constant first.
    """
    half = scipy.fft.next_fast_len(PERIOD * n // 2, real=True)
    f = np.arange(half // 2 + 1) * response.RATE / (2 * half)
    log_f, later = np.log(f[(f > 0) & (f < HIGHEST)]), np.exp(2j * np.pi * f / response.RATE)
    return half, log_f, later


def _low_pass(decade: int, factor: int, fs: float) -> tuple[Array, Array]:
    """Return the knots of the noise [Hz] from a decade on, evenly in log f, and what the low-pass leaves."""
    low, high = decade * np.log(10), np.log(HIGHEST)
    n = int(GRID * (high - low) / np.log(10)) + 2
    f = np.exp(np.linspace(low, high, n))
    taps = decimation.taps(factor)
    lags = (np.arange(taps.size) - taps.size // 2) / fs
    return f, np.cos(2 * np.pi * f[:, None] * lags) @ taps


def _factor(run: Run, channels: Sequence[str], decade: int) -> SpectralFactor:
    """Return the noise of channels of a run from 10^decade Hz on."""
    f, low_pass = _low_pass(decade, round(run.fs / response.RATE), run.fs)
    system = response.noise_system(run)
    weights, psd = response.noise_streams(run, system, f)
    G = system.select(system.inputs, channels).frequency_response(f) @ weights * np.sqrt(psd)[:, None, :]
    # What depends on the channels before it, as a command on its error, adds no direction but that of
    # rounding, another one at every frequency. What came after it could not be interpolated.
    L = cholesky_factor(G)
    pivots, whole = np.abs(np.diagonal(L, axis1=1, axis2=2)), np.linalg.norm(G, axis=2)
    depends = np.all(pivots <= RANK_TOLERANCE * whole, axis=0)
    order = tuple(int(i) for i in np.argsort(depends, kind="stable"))
    if order != tuple(sorted(order)):
        L = cholesky_factor(G[:, order])  # of one kind at all frequencies
    diagonal = np.diagonal(L, axis1=1, axis2=2)
    size = np.abs(diagonal)
    phase = np.where(size > 0, diagonal.conj() / np.where(size > 0, size, 1.0), 1.0)
    L = L * phase[:, None, :] * low_pass[:, None, None]
    independent = max(1, int(np.count_nonzero(~depends)))
    entries = np.stack([L[:, i, j] for i, j in _lower(len(channels), independent)], axis=1)
    return SpectralFactor(order, independent, UniformInterpolator(np.log(f), entries))


def cholesky_factor(G: Complex) -> Complex:
    """Return the lower triangles L with L L^* = G G^*, shape (n, C, C), for G of shape (n, C, streams)."""
    return np.asarray(np.linalg.qr(G.conj().transpose(0, 2, 1), mode="r")).conj().transpose(0, 2, 1)
