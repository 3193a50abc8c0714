"""Straight stretches of channels whose numbers are rounded, where rounding does not explain them."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.quality.resolution import Resolution
from fit.spectra import derivatives
from fit.telemetry import pieces

Array = NDArray[np.float64]

LONG = 30  # samples in a row, of values as fine as noise
SHORTEST, LONGEST = 8, 2**14  # samples of the windows in which rounding is compared with a straight line
NEIGHBOURS, FEWEST = (32, 256), 16  # windows on either side of a stretch, and fewest that show a share
USUALLY, LONGER = (
    0.1,
    12,
)  # share of windows straight by rounding, and how many in a row are not, of that share
STEP, BEND = 1.05, 2.1  # steps from a line, and of a second difference, that rounding makes of a line
FINENESS = 64  # of such a stretch, to which its ends are known
TOGETHER = 2**17  # samples that are in memory at a time


def stretches(x: Array, resolution: Resolution) -> NDArray[np.intp]:
    """Return the stretches that are on a straight line to a step, and are longer than rounding makes them.

    Where a channel moves by less than a step from sample to sample, many short windows are straight. If a
    share p of the windows of M samples is, chance makes n of them in a row straight with probability p^n:
    `LONGER` windows at p = `USUALLY`, fewer where p is less. The share is that of the windows near a
    stretch, without those of any stretch that is one line and may be a fault itself: neither its own length
    nor that of others hides it. Where the share is larger than `USUALLY`, longer windows are compared.
    """
    resolution = resolution.upper
    smooth = derivatives.chunked_true_runs(
        _bends(x, resolution, piece) <= BEND for piece in pieces(x.size - 2)
    )
    candidates = smooth[smooth[:, 1] - smooth[:, 0] >= LONG - 2] + np.array([0, 2])
    faults: list[NDArray[np.intp]] = []
    size = SHORTEST
    while len(candidates) and size <= min(LONGEST, x.size // SHORTEST):
        candidates = _lines_within(x, candidates, resolution, LONG * size // SHORTEST)
        single = [bool(_on_line(x[begin:end][None], resolution)[0]) for begin, end in candidates.tolist()]
        share = _shares(x, resolution, size, candidates, [candidates[single], *faults])
        unexplained = share <= USUALLY
        for stretch, p in zip(candidates[unexplained], share[unexplained], strict=True):
            least = LONGER * size * np.log(USUALLY) / np.log(p) if p else 0.0
            faults.append(_lines_within(x, stretch[None], resolution, max(LONG, int(least))))
        candidates, size = candidates[~unexplained], 2 * size
    longest = np.concatenate([np.zeros((0, 2), dtype=np.intp), *faults])
    return longest[np.argsort(longest[:, 0])]


def _bends(x: Array, resolution: Resolution, at: slice) -> Array:
    """Return the sizes of second differences in steps, those of the largest of three values."""
    part = x[at.start : at.stop + 2]
    steps = resolution.at(part)
    return np.abs(np.diff(part, 2)) / np.maximum(np.maximum(steps[:-2], steps[1:-1]), steps[2:])


def _shares(
    x: Array,
    resolution: Resolution,
    size: int,
    candidates: NDArray[np.intp],
    excluded: list[NDArray[np.intp]],
) -> Array:
    """Return the share of straight windows near stretches and in them, the largest of several distances.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The channel.
    resolution : Resolution
        Of its numbers.
    size : int
        Samples of a window.
    candidates : ndarray, shape (S, 2)
        The stretches.
    excluded : list of ndarray, shape (number of stretches, 2)
        Stretches whose windows do not count.

    Returns
    -------
    parameter_map : ndarray, shape (S,)
        Where too few windows are left to show it, one, or zero if there are many lines: lines with corners
        in between are interpolated, rounding makes one curve.
    """
    count = x.size // size
    valid, straight = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for rows in pieces(count, length=max(1, TOGETHER // size)):
        windows = x[rows.start * size : rows.stop * size].reshape(-1, size)
        valid[rows] = np.isfinite(windows).all(axis=1)
        straight[rows] = _on_line(windows, resolution)
    lines = np.concatenate(excluded)
    unknown = 1.0 if len(lines) < FEWEST else 0.0
    for begin, end in lines.tolist():
        valid[begin // size : (end - 1) // size + 1] = False
    at = np.flatnonzero(valid)
    total = np.concatenate([[0], np.cumsum(straight[at])])
    before, after = (
        np.searchsorted(at, candidates[:, 0] // size),
        np.searchsorted(at, candidates[:, 1] // size),
    )
    share = np.zeros(len(candidates))
    for most in NEIGHBOURS:
        first, last = np.maximum(0, before - most), np.minimum(at.size, after + most)
        number = last - first
        part = (total[last] - total[first]) / np.maximum(number, 1)
        share = np.maximum(share, np.where(number < FEWEST, unknown, part))
    return share


def _on_line(windows: Array, resolution: Resolution) -> NDArray[np.bool_]:
    """Return of which windows, shape (W, M), all samples are within a step of the line between their ends.

    Half of a step is that of the sample, and half that of the ends.
    """
    along = np.linspace(0, 1, windows.shape[1])
    line = windows[:, :1] + (windows[:, -1:] - windows[:, :1]) * along
    steps = resolution.at(windows)
    most = 0.5 * STEP * (steps + np.maximum(steps[:, :1], steps[:, -1:]))
    return np.asarray(np.all(np.abs(windows - line) <= most, axis=1))


def _lines_within(x: Array, parts: NDArray[np.intp], resolution: Resolution, least: int) -> NDArray[np.intp]:
    """Return the stretches within parts of which every `least` samples in a row are on a line."""
    lines = [
        begin + _lines(x[begin:end], resolution, least)
        for begin, end in parts.tolist()
        if end - begin >= least
    ]
    return np.concatenate([np.zeros((0, 2), dtype=np.intp), *lines])


def _lines(x: Array, resolution: Resolution, least: int) -> NDArray[np.intp]:
    """Return the stretches of one part of which every `least` samples in a row are on a line."""
    covered = np.zeros(x.size + 1, dtype=np.intp)
    every = max(1, least // FINENESS)
    windows = sliding_window_view(x, least)[::every]
    rows = max(1, TOGETHER // least)
    for start in range(0, len(windows), rows):
        at = every * (start + np.flatnonzero(_on_line(windows[start : start + rows], resolution)))
        np.add.at(covered, at, 1)
        np.add.at(covered, at + least, -1)
    return derivatives.true_runs(np.cumsum(covered[:-1]) > 0)
