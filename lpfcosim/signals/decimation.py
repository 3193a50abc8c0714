"""Telemetry below 10 Hz: one zero-phase low-pass for every channel, block by block.

The filter is flat to 1e-6 up to 0.2 of the new sample rate and 120 dB down from half of it on. Its delay is
taken into account by the time axis; half its length is lost at both ends of a run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]

PASSBAND, STOPBAND = 0.2, 0.5  # of the new sample rate
STOPBAND_DB = 126  # of each stage, so that two of them keep what is stated above


@dataclass(frozen=True)
class Grid:
    """Time axis of a recording: ``n`` samples at ``fs`` [Hz] from ``start`` [s] on."""

    n: int
    fs: float
    start: float

    def time(self, start_sample: int, stop_sample: int) -> Array:
        """Return the times of samples ``start_sample`` … ``last - 1`` [s]."""
        return self.start + np.arange(start_sample, stop_sample) / self.fs


def stages(factor: int) -> list[tuple[int, Array]]:
    """Return factor and coefficients, an odd number, of the low-passes that decimate by ``factor`` in turn.

    An even factor is halved at the end, where few samples are left for the steep filter.
    """
    if factor == 1:
        return []
    ratio, *halvings = (factor // 2, 2) if factor % 2 == 0 and factor > 2 else (factor,)
    return [(ratio, _low_pass(ratio, factor)), *((2, _low_pass(2, 2)) for _ in halvings)]


def _low_pass(divisor: int, factor: int) -> Array:
    """Return a low-pass for a decimation by ``divisor``, the first of a decimation by ``factor`` in all.

    What it lets alias above the passband of the whole is for the next stage to stop.
    """
    from scipy.signal import firwin, kaiserord  # takes its time, and what only names the models needs it not

    passband = PASSBAND / factor
    stopband = 1 / divisor - STOPBAND / factor
    size, beta = kaiserord(STOPBAND_DB, 2 * (stopband - passband))
    return firwin(size | 1, stopband + passband, window=("kaiser", beta))


def taps(factor: int) -> Array:
    """Return the coefficients of all `stages` as one low-pass at the original sample rate."""
    whole, rate = np.ones(1), 1
    for divisor, low_pass in stages(factor):
        spread = np.zeros(rate * (low_pass.size - 1) + 1)
        spread[::rate] = low_pass
        whole, rate = np.convolve(whole, spread), rate * divisor
    return whole


def grid(run: Run) -> Grid:
    """Return the time axis on which a run is recorded."""
    factor = round(run.fs / run.sample_rate)
    length = taps(factor).size
    return Grid(max(0, (run.n_samples - length) // factor + 1), run.fs / factor, (length // 2) / run.fs)


def decimate(run: Run, blocks: Iterable[Mapping[str, Array]]) -> Iterator[Mapping[str, Array]]:
    """Low-pass and decimate the channels of a run.

    Parameters
    ----------
    run : Run
        Its ``sample_rate`` is that of the result.
    blocks : iterable of mapping of str to array, shape (m,)
        The channels at 10 Hz, block after block.

    Yields
    ------
    mapping of str to array
        The channels on `grid`, to the same bits for any division into blocks.
    """
    factor = round(run.fs / run.sample_rate)
    for divisor, low_pass in stages(factor):
        blocks = _decimate_blocks(divisor, low_pass, blocks)
    yield from blocks


def _decimate_blocks(
    factor: int, low_pass: Array, blocks: Iterable[Mapping[str, Array]]
) -> Iterator[dict[str, Array]]:
    from scipy.signal import upfirdn

    delay = math.ceil((low_pass.size - 1) / factor)  # outputs before the first that has all its samples
    padded = np.concatenate([np.zeros(delay * factor - low_pass.size + 1), low_pass])
    tail: Array | None = None  # samples that later outputs need, shape (channels, n)
    for block in blocks:
        samples = np.stack(list(block.values()))
        x = samples if tail is None else np.concatenate([tail, samples], axis=1)
        n = max(0, (x.shape[1] - low_pass.size) // factor + 1)
        tail = x[:, n * factor :]
        if n:
            y = upfirdn(padded, x, 1, factor, axis=1)
            yield dict(zip(block, y[:, delay : delay + n], strict=True))
