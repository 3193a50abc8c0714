"""Straight stretches of channels whose numbers are rounded, where rounding does not explain them."""

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.quality.resolution import Resolution
from fit.spectra import derivatives

Array = NDArray[np.float64]
Intervals = NDArray[np.intp]

MIN_SAMPLES = 30  # in a row, of values as fine as noise
MIN_WINDOW, MAX_WINDOW = 8, 2**14  # samples of the windows in which rounding is compared with a straight line
REACHES = (32, 256)  # windows on either side of a stretch that show the share of straight ones
MIN_WINDOWS = 16  # that show a share
MAX_SHARE = 0.1  # of straight windows; where rounding makes more, longer windows are compared
TOLERANCE = 1.05  # steps from a line that rounding makes of it
POSITIONS = 64  # of windows in their own length, to which the ends of a stretch are known
CHUNK = 2**17  # samples of windows in memory at a time


def stretches(x: Array, resolution: Resolution, p_limit: float) -> Intervals:
    """Return the stretches that are on a straight line to a step, and are longer than rounding makes them.

    Where a channel moves by less than a step from sample to sample, many short windows are straight. If a
    share p of the windows of M samples is, chance makes n of them in a row straight with probability p^n.
    The share is that of the windows near a stretch, without those of any stretch that is one line and may be
    a fault itself: neither its own length nor that of others hides it.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The channel.
    resolution : Resolution
        Of its numbers.
    p_limit : float
        The p^n below which a stretch is a fault.

    Returns
    -------
    stretches : ndarray, shape (S, 2)
        Index of the first sample, and end.
    """
    resolution = resolution.upper
    steps = scipy.ndimage.maximum_filter1d(resolution.step_at(x), 3)[1:-1]
    is_smooth = np.abs(np.diff(x, 2)) <= 2 * TOLERANCE * steps
    candidates = derivatives.true_runs(is_smooth) + np.array([0, 2])  # two of them meet at a corner
    faults = [np.zeros((0, 2), dtype=np.intp)]
    window = MIN_WINDOW
    while len(candidates) and window <= min(MAX_WINDOW, x.size // MIN_WINDOW):
        candidates = _lines_within(x, candidates, resolution, MIN_SAMPLES * window // MIN_WINDOW)
        single = [bool(_is_straight(x[begin:end][None], resolution)[0]) for begin, end in candidates.tolist()]
        shares = _shares(x, resolution, window, candidates, np.concatenate([candidates[single], *faults]))
        is_unusual = shares <= MAX_SHARE
        for stretch, p in zip(candidates[is_unusual], shares[is_unusual], strict=True):
            length = int(window * np.log(p_limit) / np.log(p)) if p else 0
            faults.append(_lines_within(x, stretch[None], resolution, max(MIN_SAMPLES, length)))
        candidates, window = candidates[~is_unusual], 2 * window
    lines = np.concatenate(faults)
    return lines[np.argsort(lines[:, 0])]


def _shares(
    x: Array, resolution: Resolution, window: int, candidates: Intervals, excluded: Intervals
) -> Array:
    """Return the share of straight windows in and near each candidate, the largest of several distances.

    Windows in `excluded` do not count. Where too few remain to show a share, it is one, or zero if there are
    many lines: lines with corners in between are interpolated, rounding makes one curve.
    """
    windows = x[: x.size // window * window].reshape(-1, window)
    is_valid = np.asarray(np.isfinite(windows).all(axis=1))
    for begin, end in excluded.tolist():
        is_valid[begin // window : (end - 1) // window + 1] = False
    valid = np.flatnonzero(is_valid)
    counts = np.concatenate([[0], np.cumsum(_is_straight(windows[valid], resolution))])
    edges = np.searchsorted(valid, candidates // window)
    shares = np.zeros(len(candidates))
    for reach in REACHES:
        begin, end = np.maximum(0, edges[:, 0] - reach), np.minimum(valid.size, edges[:, 1] + reach)
        share = (counts[end] - counts[begin]) / np.maximum(end - begin, 1)
        unknown = 1.0 if len(excluded) < MIN_WINDOWS else 0.0
        shares = np.maximum(shares, np.where(end - begin < MIN_WINDOWS, unknown, share))
    return shares


def _is_straight(windows: Array, resolution: Resolution) -> NDArray[np.bool_]:
    """Return of which windows, shape (W, M), all samples are within a step of the line between their ends.

    Half of a step is that of the sample, and half that of the ends.
    """
    line = np.linspace(windows[:, 0], windows[:, -1], windows.shape[1], axis=1)
    steps = resolution.step_at(windows)
    limit = 0.5 * TOLERANCE * (steps + np.maximum(steps[:, :1], steps[:, -1:]))
    return np.asarray(np.all(np.abs(windows - line) <= limit, axis=1))


def _lines_within(x: Array, intervals: Intervals, resolution: Resolution, length: int) -> Intervals:
    """Return the stretches within intervals of which every `length` samples in a row are on a line."""
    lines = [np.zeros((0, 2), dtype=np.intp)]
    stride = max(1, length // POSITIONS)
    for begin, end in intervals[np.ptp(intervals, axis=1) >= length].tolist():
        windows = sliding_window_view(x[begin:end], length)[::stride]
        chunks = np.array_split(windows, 1 + windows.size // CHUNK)
        starts = stride * np.flatnonzero(np.concatenate([_is_straight(w, resolution) for w in chunks]))
        edges = np.zeros(end - begin + 1, dtype=np.intp)
        edges[starts] += 1
        edges[starts + length] -= 1
        lines.append(begin + derivatives.true_runs(np.cumsum(edges[:-1]) > 0))
    return np.concatenate(lines)
