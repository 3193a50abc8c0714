"""Telemetry below 10 Hz: one zero-phase low-pass for every channel, block by block.

The filter is flat to 1e-6 up to 0.2 of the rate that is left and 120 dB down from half of it on. Samples
stand in its middle, so that nothing is delayed; half its length is lost at both ends of a run.

It has the bits of `firwin` and `oaconvolve`; `scipy.signal` takes workers longer to read in than all else.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]

PASSED, STOPPED = 0.2, 0.5  # of the rate that is left
REJECTED = 120  # dB
TOGETHER = 4  # channels, whose transforms a processor keeps at hand
GATHERED = 10_000  # samples of each channel that are handed on, and written, at a time


@dataclass(frozen=True)
class Grid:
    """Time axis of a recording: ``n`` samples at ``fs`` [Hz] from ``start`` [s] on."""

    n: int
    fs: float
    start: float

    def time(self, first: int, last: int) -> Array:
        """Return the times of samples ``first`` … ``last - 1`` [s]."""
        return self.start + np.arange(first, last) / self.fs


def taps(factor: int) -> Array:
    """Coefficients of the low-pass, an odd number of them, for a decimation by ``factor``."""
    if factor == 1:
        return np.ones(1)
    width, cut = 2 * (STOPPED - PASSED) / factor, (STOPPED + PASSED) / factor
    size = math.ceil((REJECTED - 7.95) / 2.285 / (math.pi * width) + 1) | 1
    middle, beta = 0.5 * (size - 1), 0.1102 * (REJECTED - 8.7)
    n = np.arange(size) - middle
    kaiser = scipy.special.i0(beta * np.sqrt(1 - (n / middle) ** 2)) / scipy.special.i0(beta)
    found = cut * np.sinc(cut * n) * kaiser
    return np.asarray(found / found.sum())


class _LowPass:
    """A filter of several channels: every so many-th of the bits of `scipy.signal.oaconvolve`.

    Its taps are transformed once.
    """

    def __init__(self, factor: int) -> None:
        self._factor, self._taps = factor, taps(factor)
        self.size, lost = self._taps.size, self._taps.size - 1
        # the length of a transform that costs least for each sample, as oaconvolve has it
        best = -lost * scipy.special.lambertw(-1 / (2 * math.e * lost), k=-1).real
        self._length = int(scipy.fft.next_fast_len(math.ceil(best)))
        self._transformed = scipy.fft.rfft(self._taps, self._length)

    def __call__(self, x: Array, n: int) -> Array:
        """Filter channels, shape (C, m); return the first n samples where the filter fits, shape (C, n)."""
        (channels, m), lost = x.shape, self.size - 1
        at = lost + self._factor * np.arange(n)
        if m <= self._length:
            length = scipy.fft.next_fast_len(m + lost, real=True)
            spectra = scipy.fft.rfft(x, length, axis=1) * scipy.fft.rfft(self._taps, length)
            return np.asarray(scipy.fft.irfft(spectra, length, axis=1)[:, at])
        step = self._length - lost
        whole, rest = divmod(m, step)
        padded = np.zeros((channels, whole + (rest > 0), self._length))
        padded[:, :whole, :step] = x[:, : whole * step].reshape(channels, whole, step)
        padded[:, whole:, :rest] = x[:, np.newaxis, whole * step :]
        spectra = scipy.fft.rfft(padded, axis=2)
        spectra *= self._transformed
        found = scipy.fft.irfft(spectra, self._length, axis=2)
        found[:, 1:, :lost] += found[:, :-1, step:]
        return np.take(found.reshape(channels, -1), at // step * self._length + at % step, axis=1)


def grid(run: Run) -> Grid:
    """Time axis on which a run is recorded."""
    factor = round(run.fs / run.sample_rate)
    length = taps(factor).size
    return Grid(max(0, (run.n_samples - length) // factor + 1), run.fs / factor, (length // 2) / run.fs)


def decimate(run: Run, blocks: Iterable[Mapping[str, Array]]) -> Iterator[Mapping[str, Array]]:
    """Low-pass and thin out the channels of a run.

    Parameters
    ----------
    run : Run
        Its ``sample_rate`` is that of the result.
    blocks : iterable of mapping of str to array, shape (m,)
        The channels at 10 Hz, one stretch after the other.

    Yields
    ------
    mapping of str to array
        The channels on `grid`, alike to rounding for any division into stretches.
    """
    factor = round(run.fs / run.sample_rate)
    if factor == 1:
        yield from blocks
        return
    yield from _gathered(_thinned(_LowPass(factor), factor, blocks))


def _thinned(
    low_pass: _LowPass, factor: int, blocks: Iterable[Mapping[str, Array]]
) -> Iterator[dict[str, Array]]:
    left: dict[int, Array] = {}  # of every few channels, what the filter has still to see
    for block in blocks:
        names, found = list(block), dict[str, Array]()
        for i in range(0, len(names), TOGETHER):
            some = names[i : i + TOGETHER]
            before = left.get(i, np.empty((len(some), 0)))
            held = np.empty((len(some), before.shape[1] + block[some[0]].size))
            held[:, : before.shape[1]] = before
            for row, name in zip(held[:, before.shape[1] :], some, strict=True):
                row[:] = block[name]
            n = max(0, (held.shape[1] - low_pass.size) // factor + 1)
            if n:
                found |= zip(some, low_pass(held, n), strict=True)
            left[i] = held[:, n * factor :].copy()
        if found:
            yield found


def _gathered(blocks: Iterable[Mapping[str, Array]]) -> Iterator[dict[str, Array]]:
    """Join blocks until they have `GATHERED` samples."""
    held: list[Mapping[str, Array]] = []
    n = 0
    for block in blocks:
        held.append(block)
        n += next(iter(block.values())).size
        if n >= GATHERED:
            yield _joined(held)
            held, n = [], 0
    if held:
        yield _joined(held)


def _joined(blocks: Iterable[Mapping[str, Array]]) -> dict[str, Array]:
    first, *others = blocks
    return {name: np.concatenate([x, *(block[name] for block in others)]) for name, x in first.items()}
