"""Series over time as figures draw them: thinned, averaged, without glitches."""

from collections.abc import Iterable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.telemetry import PIECE, pieces

Array = NDArray[np.float64]

_BUCKETS = 500  # per curve


def envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a curve of at most 2 * 500 points that covers the same ink: extremes of every bucket.

    Parameters
    ----------
    time, values : ndarray, shape (N,)
        Missing samples (NaN) are passed over; a bucket of nothing else stays a gap.
    """
    if values.size <= 2 * _BUCKETS:
        return time[:], values[:]
    starts = np.linspace(0, values.size, _BUCKETS, endpoint=False).astype(int)
    x, extremes = np.empty(_BUCKETS), np.empty((_BUCKETS, 2))
    together = max(1, PIECE * _BUCKETS // values.size)  # buckets, lest a long series be there as a whole
    for some in pieces(_BUCKETS, length=together):
        index = starts[some]
        piece = slice(int(index[0]), int(starts[some.stop]) if some.stop < _BUCKETS else values.size)
        part, index = values[piece], index - index[0]
        x[some], extremes[some, 0] = time[piece][index], np.fmin.reduceat(part, index)
        extremes[some, 1] = np.fmax.reduceat(part, index)
    extremes[1::2] = extremes[1::2, ::-1]  # up in one bucket, down in the next: a slow curve stays one
    return np.repeat(x, 2), extremes.ravel()


def glitch_mask(time: Array, spans: Iterable[Sequence[float]]) -> NDArray[np.bool_]:
    """Return which samples glitches reach: the loudest take twice as long to fade as their spans tell."""
    mask = np.zeros(time.size, dtype=bool)
    for begin, end in spans:
        mask |= (time >= begin) & (time <= 2 * end - begin)
    return mask


def averaged(x: Array, length: float, every: int) -> Array:
    """Return `x` averaged with a Hann window of so many samples, NaN where that would reach what is missing.

    Of the averages it is the first and `every` so many-th after it.

    A window cut short would let through the noise of high frequencies, which the whole one averages away.
    """
    w = scipy.signal.windows.hann(max(3, round(length) | 1) + 2)[1:-1]
    known = np.isfinite(x)
    weight, total = (_thinned(y, w, every) for y in (known.astype(float), np.where(known, x, 0.0)))
    return np.where(weight > 0.9999 * w.sum(), total / w.sum(), np.nan)


def _thinned(x: Array, w: Array, every: int) -> Array:
    """Return every so many-th sample of `x` under a window of odd length, the first sample first."""
    early = w.size // 2
    padded = np.concatenate([np.zeros(-early % every), x])
    filtered = scipy.signal.upfirdn(w, padded, down=every)[-(-early // every) :]
    return np.asarray(filtered[: -(-x.size // every)], dtype=np.float64)
