"""What figures of a run show: Delta g and its terms over time, and their spectra.

A run is looked at stretch by stretch, and of a long one the spectra are means over its stretches: the memory
does not grow with the run.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.figures.series import averaged, glitch_mask
from fit.model import dynamics
from fit.spectra import Binned, Estimator, derivatives
from fit.telemetry import Telemetry, pieces

Array = NDArray[np.float64]
_Series = tuple[Array, Array]

HIGHEST = 1.0  # Hz, shown at most
SLOW, FAST = 200.0, 20.0  # s, lengths of the windows over which the residual is averaged
_LONGEST = 2**18  # samples of a stretch, 22 h of telemetry at 10 Hz
_BLOCK_SIZE = 2**15  # samples of which all columns are made


@dataclass(frozen=True)
class Terms:
    """Delta g of a run and what it is made of, up to the `HIGHEST` frequency that is shown.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    valid : ndarray of bool, shape (N,)
        False where samples are missing.
    delta_g : ndarray, shape (N,)
        The sum of all terms [m s^-2].
    terms : mapping of str to ndarray, each of shape (N,)
        The terms, with their signs, that are not zero throughout [m s^-2].
    """

    fs: float
    time: Array
    valid: NDArray[np.bool_]
    delta_g: Array
    terms: Mapping[str, Array]


def split(telemetry: Telemetry, parameters: Mapping[str, float]) -> Terms:
    """Return the terms of Delta g; of a noise run only their sum.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    """
    run = dynamics.wideband_channels(telemetry, HIGHEST)
    theta = np.array([parameters.get(name, 0.0) for name in run.parameters])
    inner = slice(derivatives.HALF, -derivatives.HALF)
    time, n = run.time[inner], run.time[inner].size
    valid, total = np.empty(n, dtype=bool), np.empty(n)
    terms = {} if telemetry.kind == "noise" else {term.name: np.zeros(n) for term in dynamics.TERMS}
    # Of weeks, all columns fill the memory.
    for piece in pieces(run.time.size, overlap=2 * derivatives.HALF, length=_BLOCK_SIZE):
        columns = dynamics.columns(_part(run, piece), dynamics.delays(theta))
        samples = slice(piece.start, piece.start + columns.valid.size)
        valid[samples], total[samples] = columns.valid, dynamics.total(columns, theta)
        for name, term in (dynamics.terms(columns, theta) if terms else {}).items():
            if np.any(term):  # zeros that nobody touches take no memory
                terms[name][samples] = term
    known = {name: term for name, term in terms.items() if np.any(term)}  # not where nothing is commanded
    return Terms(run.fs, time, valid, total, known)


def _part(run: dynamics.Channels, piece: slice) -> dynamics.Channels:
    """Return a stretch of the channels of a run."""
    of_run: dict[str, Any] = {
        name: getattr(run, name)[piece] for name in ("time", "valid", *dynamics.CHANNELS)
    }
    return replace(run, **of_run, means={name: x[piece] for name, x in run.means.items()})


@dataclass(frozen=True)
class Analysis:
    """What the figures of a run show: its residual over time, and spectra. What is zero throughout has none.

    Series are pairs of hours since the start of the run and values [fm s^-2] less their mean, NaN where
    samples are missing; None where nothing is left of the run.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    missing, masked : ndarray, shape (G, 2)
        Begin and end of every stretch where samples are missing, and of glitches [h since the start].
    fast, slow : tuple of ndarray, or None
        Delta g averaged over `FAST` and over `SLOW`.
    signal : tuple of ndarray, or None
        Second derivative of o_12 averaged over `FAST`; None of a noise run.
    asd : Binned or None
        Of Delta g without what was masked; None of a simulation without noise.
    terms : mapping of str to Binned
        Of its terms; none of a noise run.
    """

    fs: float
    missing: Array
    masked: Array
    fast: _Series | None
    slow: _Series | None
    signal: _Series | None
    asd: Binned | None
    terms: Mapping[str, Binned]


def analysed(
    telemetry: Telemetry, parameters: Mapping[str, float], masked: Sequence[tuple[float, float]] = ()
) -> Analysis:
    """Return what the figures of a run show; see `split`.

    The spectrum of Delta g leaves out what was `masked`, begin and end [s], unless that is half of a stretch.
    """
    start = float(telemetry.time[0])
    fast, slow, signal, asd = _Averaged(FAST), _Averaged(SLOW), _Averaged(FAST), _Mean()
    terms, fs, begin, driven = dict[str, _Mean](), telemetry.fs, start, telemetry.kind != "noise"
    missing: list[NDArray[np.bool_]] = []
    stretches = 0
    for run, stretch, whole in _stretches(telemetry, parameters):
        begin = begin if missing else float(run.time[0])
        fs, zero = run.fs, np.zeros(run.time.size)
        missing.append(~run.valid[stretch])
        for average in (fast, slow):
            average.add(run, run.delta_g, stretch)
        if driven:
            signal.add(run, run.terms.get("ddo_12", zero), stretch)
        samples = slice(stretch.start, stretch.start + whole)
        valid = run.valid[samples]
        if not valid.any():
            continue
        estimator = Estimator(valid, fs, HIGHEST)
        is_unmasked = valid & ~glitch_mask(run.time[samples], masked)
        enough = valid.sum() > is_unmasked.sum() > is_unmasked.size / 2
        asd.add(Estimator(is_unmasked, fs, HIGHEST) if enough else estimator, run.delta_g[samples])
        for name in run.terms:
            terms.setdefault(name, _Mean()).add(estimator, run.terms[name][samples])
        stretches += 1
        del run  # before there is another one
    return Analysis(
        fs,
        (derivatives.chunked_true_runs(missing) / fs + begin - start) / 3600,
        (np.reshape(masked, (-1, 2)) - start) / 3600,
        fast.series(start),
        slow.series(start),
        signal.series(start) if signal.told else None,
        asd.binned(stretches) if stretches and fast.told else None,
        {name: term.binned(stretches) for name, term in terms.items()},
    )


def _stretches(telemetry: Telemetry, parameters: Mapping[str, float]) -> Iterator[tuple[Terms, slice, int]]:
    """Yield the terms of a run stretch by stretch, which samples of them, and of how many to take spectra.

    All spectra are of as many samples. Beside those are as many more as the averages need.
    """
    taps, factor = derivatives.low_pass(telemetry.fs, HIGHEST, 3 * HIGHEST)
    reach, fs = taps.size - 1 + 2 * derivatives.HALF * factor, telemetry.fs / factor
    n = (telemetry.size - 1 - reach) // factor + 1
    if n <= _LONGEST:
        run = split(telemetry, parameters)
        yield run, slice(0, run.time.size), run.time.size
        return
    even, count = math.lcm(_every(FAST, fs), _every(SLOW, fs)), -(-n // _LONGEST)
    length, margin = n // count // even * even, even * math.ceil((SLOW * fs / 2 + 2) / even)
    for k in range(count):
        start, stop = k * length, n if k == count - 1 else (k + 1) * length
        begin, end = max(0, start - margin), min(n, stop + margin)
        part = slice(factor * begin, factor * (end - 1) + reach + 1 if end < n else telemetry.size)
        yield split(telemetry.part(part), parameters), slice(start - begin, stop - begin), length


def _every(length: float, fs: float) -> int:
    """Return of how many samples one is drawn of averages over so many seconds."""
    return max(1, round(length / 4 * fs))


class _Averaged:
    """A series averaged over windows of so many seconds; `told` is whether any of it is not zero."""

    def __init__(self, length: float) -> None:
        self.told = False
        self._length, self._sum, self._count = length, 0.0, 0
        self._time: list[Array] = []
        self._values: list[Array] = []

    def add(self, run: Terms, x: Array, stretch: slice) -> None:
        """Add a stretch, shape (N,), of which some samples are kept."""
        known, every = x[stretch][run.valid[stretch]], _every(self._length, run.fs)
        mean = float(known.mean()) if known.size else 0.0
        averages = averaged(np.where(run.valid, x - mean, np.nan), self._length * run.fs, every)
        output = slice(-(-stretch.start // every), -(-stretch.stop // every))
        self._time.append(run.time[::every][output].copy())  # else the whole stretch would stay
        self._values.append(averages[output] + mean)
        self._sum, self._count = self._sum + float(known.sum()), self._count + known.size
        self.told = self.told or bool(np.any(known))

    def series(self, start: float) -> _Series | None:
        """Return hours since `start`, and the averages less the mean [fm s^-2]; None if nothing is there."""
        if not self._count:
            return None
        values = np.concatenate(self._values) - self._sum / self._count
        return (np.concatenate(self._time) - start) / 3600, 1e15 * values


class _Mean:
    """The mean periodogram of a series over stretches of a run, zero where it is not added."""

    def __init__(self) -> None:
        self._estimator: Estimator | None = None
        self._power: Array = np.zeros(1)

    def add(self, estimator: Estimator, x: Array) -> None:
        """Add a stretch, shape (N,)."""
        self._power = self._power + estimator.power(x)
        self._estimator = self._estimator or estimator

    def binned(self, stretches: int) -> Binned:
        """Return its ASD, of so many stretches."""
        assert self._estimator is not None
        return self._estimator.binned(self._power / stretches, stretches)
