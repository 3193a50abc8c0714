"""Straight stretches of channels whose numbers are rounded, where rounding does not explain them."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.inspection.resolution import Resolution
from fit.signal import derivatives
from fit.telemetry import Row, pieces

Array = NDArray[np.float64]

LONG = 30  # samples in a row, of values as fine as noise
SHORTEST, LONGEST = 8, 2**14  # samples of the stretches that rounding is tried to explain
WINDOWS = 1000  # of such stretches, from all of a run
USUALLY, LONGER = 0.1, 12  # share of them that are straight by rounding, and how much longer no other is
STEP, BEND = 1.05, 2.1  # steps from a line, and of a second difference, that rounding makes of a line
FINENESS = 64  # of such a stretch, to which its ends are known
TOGETHER = 2**17  # samples that are in memory at a time


def stretches(x: Row, resolution: Resolution) -> NDArray[np.intp]:
    """Return the stretches that are on a straight line to a step, and are longer than rounding makes them.

    Where a channel moves by less than a step from sample to sample, many short stretches are: how long those
    are is seen in the channel itself.
    """
    size, most = SHORTEST, min(LONGEST, x.size // 8)
    share = _share(x, resolution, size)
    fine = share == 0
    while share > USUALLY and size < most:
        size *= 2
        share = _share(x, resolution, size)
    if share > USUALLY:
        return np.zeros((0, 2), dtype=np.intp)
    least = LONG if fine else max(LONG, LONGER * size)
    smooth = derivatives.stretches_of(_bends(x, resolution, piece) <= BEND for piece in pieces(x.size - 2))
    found = [
        begin + stretch
        for begin, end in smooth[smooth[:, 1] - smooth[:, 0] >= least - 2] + np.array([0, 2])
        for stretch in _lines(x[begin:end], resolution, least)
    ]
    return np.array(found, dtype=np.intp).reshape(-1, 2)


def _bends(x: Row, resolution: Resolution, at: slice) -> Array:
    """Return the sizes of second differences in steps."""
    part = x[at.start : at.stop + 2]
    return np.abs(np.diff(part, 2)) / resolution.at(part[1:-1])


def _share(x: Row, resolution: Resolution, size: int) -> float:
    """Return which share of the stretches of so many samples, from all of a run, is straight."""
    starts = np.linspace(0, x.size - size, min(WINDOWS, x.size // size)).astype(np.intp)
    windows = np.stack([x[start : start + size] for start in starts.tolist()])
    return float(np.mean(_on_line(windows, resolution)))


def _on_line(windows: Array, resolution: Resolution) -> NDArray[np.bool_]:
    """Tell of which windows, shape (W, M), all samples are within a step of the line between their ends."""
    along = np.linspace(0, 1, windows.shape[1])
    line = windows[:, :1] + (windows[:, -1:] - windows[:, :1]) * along
    return np.asarray(np.all(np.abs(windows - line) <= STEP * resolution.at(windows), axis=1))


def _lines(x: Array, resolution: Resolution, least: int) -> NDArray[np.intp]:
    """Return the stretches of a part of a channel of which every `least` samples in a row are on a line."""
    found = np.zeros(x.size + 1, dtype=np.intp)
    every = max(1, least // FINENESS)
    windows = sliding_window_view(x, least)[::every]
    rows = max(1, TOGETHER // least)
    for start in range(0, len(windows), rows):
        at = every * (start + np.flatnonzero(_on_line(windows[start : start + rows], resolution)))
        np.add.at(found, at, 1)
        np.add.at(found, at + least, -1)
    return derivatives.stretches(np.cumsum(found[:-1]) > 0)
