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
    """A filter of many channels: the bits of `scipy.signal.oaconvolve`, its taps transformed once."""

    def __init__(self, low_pass: Array) -> None:
        self.size = low_pass.size
        self._taps = low_pass
        lost = low_pass.size - 1
        # the length of a transform that costs least for each sample, as oaconvolve has it
        best = -lost * scipy.special.lambertw(-1 / (2 * math.e * lost), k=-1).real
        self._length = int(scipy.fft.next_fast_len(math.ceil(best)))
        self._transformed = scipy.fft.rfft(low_pass, self._length)

    def __call__(self, x: Array) -> Array:
        """Return the filtered channel where the filter fits."""
        lost, step = self.size - 1, self._length - self.size + 1
        if x.size <= self._length:
            length = scipy.fft.next_fast_len(x.size + lost, real=True)
            spectrum = scipy.fft.rfft(x, length) * scipy.fft.rfft(self._taps, length)
            return np.asarray(scipy.fft.irfft(spectrum, length)[lost : x.size])
        blocks = -(-x.size // step)
        padded = np.zeros(blocks * step)
        padded[: x.size] = x
        spectra = scipy.fft.rfft(padded.reshape(blocks, step), self._length, axis=1)
        spectra *= self._transformed
        found = scipy.fft.irfft(spectra, self._length, axis=1)
        found[1:, :lost] += found[:-1, step:]
        return np.asarray(found[:, :step].reshape(-1)[lost : x.size])


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
    low_pass = _LowPass(taps(factor))
    left: dict[str, Array] = {}
    for block in blocks:
        held = {name: np.concatenate([left.get(name, x[:0]), x]) for name, x in block.items()}
        n = max(0, (next(iter(held.values())).size - low_pass.size) // factor + 1)
        if n:
            yield {name: low_pass(x)[::factor][:n].copy() for name, x in held.items()}
        left = {name: x[n * factor :] for name, x in held.items()}
