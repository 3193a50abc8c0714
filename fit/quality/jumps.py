"""Jumps and wild samples of a channel.

A body does not jump: of a read-out a jump or a wild sample is a fault whatever the forces. Commands may jump.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import Cause

Array = NDArray[np.float64]

BLOCK = 500  # samples over which noise is compared
#: Verb and limit by kind, in standard deviations of noise; smaller wild samples are masked as glitches.
LIMITS: Mapping[str, tuple[str, float]] = {"jump": ("jumps by", 20.0), "wild sample": ("is off by", 200.0)}
ISOLATED = 8.0  # ratio to what lies around it
MAX_ROUNDING = 4.0  # steps to which a read-out is rounded, up to which it does not jump
SUSPECT = 5.5  # standard deviations of second differences, which are 15 of those of a jump
SYMMETRIC = 0.05  # of a jump: so little its ends may differ in size where only the sign changes


@dataclass(frozen=True)
class SampleFault:
    """A fault of the samples of a channel.

    Attributes
    ----------
    kind, text : str
        Identifier, and words that follow the name of the channel.
    begin, end : float
        Seconds since the start of the run.
    size : float, optional
        Its amount, in `unit`.
    unit : str
        Of the amount.
    """

    kind: str
    text: str
    begin: float
    end: float
    size: float | None = None
    unit: str = "1"

    def as_cause(self, run: Telemetry, channel: str) -> Cause:
        """Return the record of the fault in a channel of a run."""
        words = f"{channel} {self.text} at {self.begin:.7g} s"
        return Cause(run.run, channel, self.kind, self.size, None, self.unit, words, str(run.path))


def jumps(x: Array, fs: float, step: float = 0.0, unit: str = "m") -> Iterator[SampleFault]:
    """Yield the largest jump or wild sample of a channel, if neither noise nor a force explains it.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The channel.
    fs : float
        Its sample rate [Hz].
    step : float
        To which it is rounded: a few are no jump.
    unit : str
        Of the channel.
    """
    values, half = np.asarray(x, dtype=np.float64), max(5, round(1.5 * fs))
    missing = np.isnan(values)
    if missing.any():
        values, masked = derivatives.interpolate_gaps(values, fs)
        missing |= masked
    if _largest(np.diff(values, 2), SUSPECT, MAX_ROUNDING * step) is None:
        return
    shapes = _detrended_shapes(half)
    near_gap = np.convolve(missing, np.ones(2 * half + 1), mode="valid") > 0.5 if missing.any() else None
    for kind, (verb, limit) in LIMITS.items():
        weights = shapes[kind] / (shapes[kind] @ shapes[kind])
        sizes = scipy.signal.oaconvolve(values - values.mean(), weights[::-1], mode="valid")
        if near_gap is not None:
            sizes[near_gap] = 0.0
        peak = _largest(sizes, limit, MAX_ROUNDING * step)
        if peak is None or not _is_isolated(sizes, peak, half):
            continue
        part = values[max(0, peak - half) : peak + 3 * half + 1]
        likeness = {
            shape: float(np.abs(np.correlate(part, w, mode="valid")).max() / np.linalg.norm(w))
            for shape, w in shapes.items()
        }
        if max(likeness, key=lambda shape: likeness[shape]) == kind:
            time, size = (peak + half) / fs, float(sizes[peak])
            levels = values[peak + half - 2 : peak + half + 4].reshape(2, 3).mean(axis=1)
            flips = kind == "jump" and abs(levels.sum()) < SYMMETRIC * abs(np.ptp(levels))
            text = f"{'changes its sign and ' * bool(flips)}{verb} {size:.2g} {unit}"
            yield SampleFault(kind, text, time, time, size, unit)


#: What a body does that jumps, a wild sample, and a body without a force on it, from the middle on.
_SHAPES: Mapping[str, Callable[[NDArray[np.intp]], Array]] = {
    "jump": lambda n: 0.5 * np.sign(n - 0.5),
    "wild sample": lambda n: 1.0 * (n == 0),
    "turn": lambda n: np.maximum(n, 0.0),
}


@lru_cache(maxsize=4)
def _detrended_shapes(half: int) -> Mapping[str, Array]:
    """Return the residuals of the shapes after the fit of a cubic, each of shape (2 half + 1,)."""
    n = np.arange(-half, half + 1)
    cubic = (n / half) ** np.arange(4)[:, None]
    return {k: shape(n) - cubic.T @ np.linalg.lstsq(cubic.T, shape(n))[0] for k, shape in _SHAPES.items()}


def _largest(sizes: Array, limit: float, floor: float) -> int | None:
    """Return the sample of the size that is farthest beyond the noise of its block.

    None if that is within the limit, in standard deviations, or it is below `floor`.
    """
    if sizes.size < BLOCK:
        return None
    padded = np.pad(sizes, (0, -sizes.size % BLOCK), mode="reflect")
    blocks = padded.reshape(-1, BLOCK)
    noise = np.maximum(
        scipy.stats.median_abs_deviation(blocks, axis=1, scale="normal"), max(floor / limit, 1e-300)
    )
    ratio = (np.abs(blocks) / noise[:, None]).ravel()[: sizes.size]
    peak = int(np.argmax(ratio))
    return peak if ratio[peak] > limit else None


def _is_isolated(sizes: Array, peak: int, half: int) -> bool:
    neighbours = (
        sizes[max(0, peak - 8 * half) : max(0, peak - 2 * half)],
        sizes[peak + 2 * half : peak + 8 * half],
    )
    largest = max((float(np.abs(part).max()) for part in neighbours if part.size), default=np.inf)
    return bool(abs(float(sizes[peak])) > ISOLATED * largest)


def command_jumps(run: Telemetry) -> Iterator[Cause]:
    """Yield jumps and wild samples of commands, which are only faults where the equation fails."""
    for name in ("f_x_1", "f_x_2"):
        for fault in jumps(run.channels[name], run.fs, unit="m s-2"):
            yield fault.as_cause(run, name)
