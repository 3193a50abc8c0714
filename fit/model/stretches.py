"""Long runs piece by piece: overlapping stretches whose results, put together, are those of the whole run."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.signal import derivatives
from fit.telemetry import Telemetry, read_stretch, samples

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

OUTPUTS = 14_400  # per stretch: 4 h at 1 Hz
MARGIN = 400.0  # s, kept on either side for `derivatives.bridge` to see gaps whole and for filters to run in


@dataclass(frozen=True)
class Grid:
    """Where the low-passed, differentiated samples of a run lie.

    Attributes
    ----------
    samples : int
        Of the file.
    reach : int
        Samples of the file that the first output needs beyond its own, on both sides together.
    factor : int
        Samples of the file per output.
    """

    samples: int
    reach: int
    factor: int

    @property
    def outputs(self) -> int:
        """Number of outputs, zero for a run shorter than the filters."""
        return max(0, (self.samples - 1 - self.reach) // self.factor + 1)


def grid(samples: int, fs: float) -> Grid:
    """Return the grid of a run of that many samples at `fs` [Hz]."""
    taps, factor = derivatives.low_pass(fs)
    return Grid(samples, taps.size - 1 + 2 * derivatives.HALF * factor, factor)


@dataclass(frozen=True)
class Stretch:
    """A piece of a run and which of its outputs to keep."""

    telemetry: Telemetry
    keep: slice


def cut(path: Path, fs: float) -> Iterator[Stretch]:
    """Read a file in pieces of `OUTPUTS` outputs each, with all around that they depend on."""
    whole = grid(samples(path), fs)
    margin = int(np.ceil(MARGIN * fs / whole.factor))
    for first in range(0, whole.outputs, OUTPUTS):
        last = min(first + OUTPUTS, whole.outputs)
        begin, end = max(0, first - margin), min(whole.outputs, last + margin)
        stop = whole.factor * (end - 1) + whole.reach + 1 if end < whole.outputs else None
        yield Stretch(read_stretch(path, whole.factor * begin, stop), slice(first - begin, last - begin))


def reduced(x: Array, fs: float) -> tuple[Array, Flags]:
    """Low-pass and decimate a channel as `dynamics.channels` does; tell which samples gaps reach."""
    taps, factor = derivatives.low_pass(fs)
    filled, masked = derivatives.bridge(x, fs)
    touched = derivatives.decimate(masked.astype(float), np.ones_like(taps), factor) > 0.5
    return derivatives.decimate(filled, taps, factor), touched


def differentiated(x: Array, masked: Flags, fs: float) -> tuple[Array, Array, Flags]:
    """Return a reduced channel, its second derivative and which samples gaps reach, as `dynamics.columns`.

    `fs` [Hz] is the rate of the reduced channel; all are 2 HALF samples shorter.
    """
    inner = slice(derivatives.HALF, -derivatives.HALF)
    near = derivatives.apply(np.ones(2 * derivatives.HALF + 1), masked.astype(float)) > 0.5
    return x[inner], derivatives.apply(derivatives.stencil(0.0, 2) * fs**2, x), near
