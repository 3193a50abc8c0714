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

Array = NDArray[np.float64]

BLOCK = 500  # samples over which noise is compared
JUMP, WILD = 20.0, 200.0  # standard deviations of what noise does; wild samples up to here are masked
ISOLATED = 8.0  # ratio to what lies around it
MAX_ROUNDING = 4.0  # steps to which a read-out is rounded, up to which it does not jump
SUSPECT = 5.5  # standard deviations of second differences, which are 15 of those of a jump
SYMMETRIC = 0.05  # of a jump: so little its ends may differ in size where only the sign changes
GAUSSIAN = 1.4826  # standard deviation over median absolute deviation


@dataclass(frozen=True)
class SampleFault:
    """A fault of the samples of a channel.

    Attributes
    ----------
    text : str
        In words that follow the name of the channel.
    begin, end : float
        Where, seconds since the start of the run.
    is_repetition : bool
        Whether it is no more than samples repeated.
    """

    text: str
    begin: float
    end: float
    is_repetition: bool = False


def jumps(x: Array, fs: float, step: float = 0.0) -> Iterator[SampleFault]:
    """Yield the largest jump or wild sample of a read-out, if neither noise nor a force explains it.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The read-out.
    fs : float
        Its sample rate [Hz].
    step : float
        To which it is rounded: a few are no jump.
    """
    values, half = np.asarray(x[:], dtype=np.float64), max(5, round(1.5 * fs))
    missing = np.isnan(values)
    if missing.any():
        values, masked = derivatives.interpolate_gaps(values, fs)
        missing |= masked
    if _largest(np.diff(values, 2), SUSPECT, MAX_ROUNDING * step) is None:
        return
    shapes = _detrended_shapes(half)
    near_gap = np.convolve(missing, np.ones(2 * half + 1), mode="valid") > 0.5 if missing.any() else None
    for name, limit in (("jumps by", JUMP), ("is off by", WILD)):
        weights = shapes[name] / (shapes[name] @ shapes[name])
        sizes = scipy.signal.oaconvolve(values - values.mean(), weights[::-1], mode="valid")
        if near_gap is not None:
            sizes[near_gap] = 0.0
        at = _largest(sizes, limit, MAX_ROUNDING * step)
        if at is None or not _is_isolated(sizes, at, half):
            continue
        part = values[max(0, at - half) : at + 3 * half + 1]
        likeness = {
            shape: float(np.abs(np.correlate(part, w, mode="valid")).max() / np.linalg.norm(w))
            for shape, w in shapes.items()
        }
        if max(likeness, key=lambda shape: likeness[shape]) == name:
            middle = at + half
            before, after = (
                float(values[middle - 2 : middle + 1].mean()),
                float(values[middle + 1 : middle + 4].mean()),
            )
            flips = name == "jumps by" and abs(before + after) < SYMMETRIC * abs(before - after)
            text = f"{'changes its sign and ' * flips}{name} {sizes[at]:.2g} m"
            yield SampleFault(text, middle / fs, middle / fs)


#: A jump, a wild sample, and what a body does without a force on it, at the sample in the middle.
_SHAPES: Mapping[str, Callable[[NDArray[np.intp]], Array]] = {
    "jumps by": lambda n: 0.5 * np.sign(n - 0.5),
    "is off by": lambda n: 1.0 * (n == 0),
    "turns": lambda n: np.maximum(n, 0.0),
}


@lru_cache(maxsize=4)
def _detrended_shapes(half: int) -> Mapping[str, Array]:
    """Return the residuals of the shapes after the fit of a cubic, each of shape (2 half + 1,)."""
    n = np.arange(-half, half + 1)
    cubic = (n / half) ** np.arange(4)[:, None]
    return {k: shape(n) - cubic.T @ np.linalg.lstsq(cubic.T, shape(n))[0] for k, shape in _SHAPES.items()}


def _largest(sizes: Array, limit: float, floor: float) -> int | None:
    """Return where a size is farthest beyond the noise of its block.

    None if that is within the limit, in standard deviations, or it is below `floor`.
    """
    n = sizes.size
    if n < BLOCK:
        return None
    if lacking := -n % BLOCK:  # at the end the last ones come again, backwards
        sizes = np.concatenate([sizes, sizes[n - 1 - lacking : n - 1][::-1]])
    blocks = np.abs(sizes).reshape(-1, BLOCK)
    # about zero, as a cubic has been subtracted; every fifth sample is as good
    noise = np.maximum(GAUSSIAN * np.median(blocks[:, ::5], axis=1), max(floor / limit, 1e-300))
    ratio = blocks.max(axis=1) / noise
    block = int(np.argmax(ratio))
    if ratio[block] <= limit:
        return None
    at = block * BLOCK + int(np.argmax(blocks[block]))
    return min(at, 2 * (n - 1) - at)


def _is_isolated(sizes: Array, at: int, half: int) -> bool:
    around = sizes[max(0, at - 8 * half) : max(0, at - 2 * half)], sizes[at + 2 * half : at + 8 * half]
    largest = max((float(np.abs(part).max()) for part in around if part.size), default=np.inf)
    return bool(abs(float(sizes[at])) > ISOLATED * largest)


def command_jumps(run: Telemetry) -> Iterator[str]:
    """Yield jumps and wild samples of commands, which are only faults where the equation fails."""
    for name in ("f_x_1", "f_x_2"):
        for fault in jumps(run.channels[name], run.fs):
            yield f"{run.path}: {name} {fault.text} s-2 at {fault.begin:.7g} s"
