"""Telemetry below 10 Hz: one zero-phase low-pass for every channel, block by block.

The filter is flat to 1e-6 up to 0.2 of the rate that is left and 120 dB down from half of it on. Samples
stand in its middle, so that nothing is delayed; half its length is lost at both ends of a run.

Its taps have the bits of `firwin`; `scipy.signal` takes workers longer to read in than all else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]

PASSED, STOPPED = 0.2, 0.5  # of the rate that is left
REJECTED = 120  # dB
TOGETHER = 6  # channels; as many as the compiled filter takes
GATHERED = 10_000  # samples of each channel that are handed on, and written, at a time

#: ``(taps, factor, x, out)``: fills ``out``, shape (n, TOGETHER), with every so many-th output of a symmetric
#: filter of the columns of ``x``, from the first where it fits.
LowPass = Callable[[Array, int, Array, Array], None]


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


def plain(taps: Array, factor: int, x: Array, out: Array) -> None:
    """Filter by NumPy, as `LowPass` says."""

    def seen(j: int) -> Array:
        return x[j : j + factor * len(out) : factor]  # by tap j, for every output

    half = taps.size // 2
    out[:] = 0
    for j in range(half):  # the order of sums is that of the compiled filter, and so are the bits
        out += taps[j] * (seen(j) + seen(2 * half - j))
    out += taps[half] * seen(half)


def grid(run: Run) -> Grid:
    """Time axis on which a run is recorded."""
    factor = round(run.fs / run.sample_rate)
    length = taps(factor).size
    return Grid(max(0, (run.n_samples - length) // factor + 1), run.fs / factor, (length // 2) / run.fs)


def decimate(
    run: Run, blocks: Iterable[Mapping[str, Array]], low_pass: LowPass = plain
) -> Iterator[Mapping[str, Array]]:
    """Low-pass and thin out the channels of a run.

    Parameters
    ----------
    run : Run
        Its ``sample_rate`` is that of the result.
    blocks : iterable of mapping of str to array, shape (m,)
        The channels at 10 Hz, one stretch after the other.
    low_pass : LowPass
        Whoever filters.

    Yields
    ------
    mapping of str to array
        The channels on `grid`, to the same bits for any division into stretches.
    """
    factor = round(run.fs / run.sample_rate)
    if factor == 1:
        yield from blocks
        return
    yield from _gathered(_thinned(low_pass, factor, blocks))


def _thinned(
    low_pass: LowPass, factor: int, blocks: Iterable[Mapping[str, Array]]
) -> Iterator[dict[str, Array]]:
    coefficients = taps(factor)
    left: dict[int, Array] = {}  # of every few channels, what the filter has still to see
    for block in blocks:
        names, found, n = list(block), dict[str, Array](), 0
        for i in range(0, len(names), TOGETHER):
            some = names[i : i + TOGETHER]
            before = left.get(i, np.empty((0, TOGETHER)))
            held = np.zeros((len(before) + block[some[0]].size, TOGETHER))
            held[: len(before)] = before
            for k, name in enumerate(some):
                held[len(before) :, k] = block[name]
            n = max(0, (len(held) - coefficients.size) // factor + 1)
            out = np.empty((n, TOGETHER))
            low_pass(coefficients, factor, held, out)
            found |= zip(some, out.T, strict=False)
            left[i] = held[n * factor :].copy()
        if n:
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
