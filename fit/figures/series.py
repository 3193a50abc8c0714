"""Series over time as figures draw them: thinned, averaged, without glitches."""

from collections.abc import Iterable, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

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
        return time, values
    starts = np.linspace(0, values.size, _BUCKETS, endpoint=False).astype(int)
    extremes = np.stack([np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)], axis=1)
    extremes[1::2] = extremes[1::2, ::-1]  # up in one bucket, down in the next: a slow curve stays one
    return np.repeat(time[starts], 2), extremes.ravel()


def glitch_mask(time: Array, spans: Iterable[Sequence[float]]) -> NDArray[np.bool_]:
    """Return a mask of samples affected by glitches: the loudest take twice their spans to fade."""
    mask = np.zeros(time.size, dtype=bool)
    for begin, end in spans:
        mask |= (time >= begin) & (time <= 2 * end - begin)
    return mask


def averaged(x: Array, length: float, stride: int) -> Array:
    """Return every `stride`-th average of `x` under a Hann window of `length` samples.

    NaN where the window would reach what is missing: one cut short would let through the noise of high
    frequencies, which the whole one averages away.
    """
    w = scipy.signal.windows.hann(max(3, round(length) | 1) + 2)[1:-1]
    known = np.isfinite(x)
    weight, total = (_filtered(y, w, stride) for y in (known.astype(float), np.where(known, x, 0.0)))
    return np.where(weight > (1 - 1e-9) * w.sum(), total / w.sum(), np.nan)


def _filtered(x: Array, w: Array, stride: int) -> Array:
    """Return the sums of `x` under a window of odd length about every `stride`-th sample."""
    delay = w.size // 2
    padded = np.concatenate([np.zeros(-delay % stride), x])
    filtered = scipy.signal.upfirdn(w, padded, down=stride)[-(-delay // stride) :]
    return np.asarray(filtered[: -(-x.size // stride)], dtype=np.float64)
