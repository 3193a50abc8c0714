"""Samples of one channel that no instrument gives: constant, on a straight line, or apart from all others.

All of it shows in the channel alone, at the rate of its archive, by its first and second differences. A body
does not jump: a read-out that does is at fault whatever the forces. Commands are constant where no loop feeds
them back, and may jump.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

MIN_FLAT = 8  # second differences in a row that are zero: a stretch
NEARBY = 2000  # samples about a stretch that show how often noise and rounding make a difference zero
MAX_SHARE, ROUNDED = 0.01, 5.0  # of differences that are zero, and times those of one step of rounding
WINDOW = 31  # second differences that show the noise around one
LIMIT = 30.0  # their medians, from which a second difference is apart: noise and motion make up to 15
FLOOR = 0.1  # of the median of all second differences: least noise
MAX_STEPS = 4.0  # of rounding, up to which nothing is apart
MAX_WIDTH = 2.6  # samples of a jump: an anti-alias filter makes up to 2.3, a loop that follows its guidance 3
MIN_NOISE = 0.5  # of fifth over fourth differences: noise has 1.5, a sine 2 pi f / fs
MAX_ROUNDING = 16  # times that of a second difference in a fifth one, with margin


def is_noisy(x: Array) -> bool:
    """Return whether a channel changes nearly always, as noise makes it."""
    return int(np.count_nonzero(x[1:] == x[:-1])) < 0.5 * (x.size - 1)


def check_samples(
    run: Telemetry, read_outs: Sequence[str], noisy: Sequence[str], n_channels: int = 1
) -> Iterator[Finding]:
    """Yield the faults of the samples of a run.

    Parameters
    ----------
    run : Telemetry
        The run; nan where samples do not count.
    read_outs : sequence of str
        Channels that show positions.
    noisy : sequence of str
        Channels that should be noise.
    n_channels : int
        Channels of the campaign, which share the budget of false alarms.
    """
    channels = [(name, x) for name in noisy if np.isfinite(x := run.channels[name]).any()]
    faults = [(name, fault) for name, x in channels for fault in _flat_faults(x, run.fs, n_channels)]
    for name in read_outs:
        for sample, size in outliers(run.channels[name])[1][:1]:
            faults.append((name, ("invalid_data", f"jumps by {size:.2g} m at {sample / run.fs:.7g} s")))
    for name, (code, words) in faults:
        yield Finding(code, f"{run.path}: {name} {words}", run.run, name)


def _flat_faults(x: Array, fs: float, n_channels: int) -> Iterator[tuple[str, str]]:
    """Yield code and words of where a channel of noise is constant or on a straight line.

    A channel of a simulation without noise may be: it rests until an injection begins.
    """
    if np.nanmin(x) == np.nanmax(x):
        yield "invalid_data", f"is constant throughout, at {x[np.isfinite(x)][0]:.4g}"
        return
    size, rounding = np.abs(np.diff(x, 2)), _rounding(x)
    flat = (size <= max(rounding, 1e-9 * float(np.nanmedian(size)))) | (x[1:-1] == x[:-2])
    fourth, fifth = (np.abs(np.diff(x, order))[~flat[1:][: x.size - order]] for order in (4, 5))
    if fifth.size and not np.nanmedian(fifth) > max(
        MIN_NOISE * np.nanmedian(fourth), MAX_ROUNDING * rounding
    ):
        return
    stretches = _stretches(flat, p_limit("straight lines", n_channels * x.size))
    for begin, end in stretches:
        seconds = (end - begin) / fs
        words = f"is constant or a straight line for {seconds:g} s at {begin / fs:.7g} s"
        yield "invalid_data", words
    one_step = np.mean(~flat & (size < 1.5 * np.min(size[~flat], initial=np.inf)))
    share = float(np.mean(flat))
    if not stretches and share > MAX_SHARE + ROUNDED * one_step:
        words = (
            f"is interpolated: {100 * share:.0f} % of its samples lie on the line between their neighbours"
        )
        yield "interpolated", words


def _rounding(x: Array) -> float:
    """Return what double precision may make of a second difference of a channel."""
    return 4 * float(np.spacing(np.nanmax(np.abs(x))))


def _stretches(flat: NDArray[np.bool_], limit: float) -> list[tuple[int, int]]:
    """Return first sample and end of stretches of flat samples, if chance makes each with p < `limit`.

    Where a share p of the samples nearby is flat, n of them are in a row with probability p^n.
    """
    stretches = []
    counts = np.concatenate([[0], np.cumsum(flat)])
    for begin, end in derivatives.true_runs(flat).tolist():
        reach = max(NEARBY, 4 * (end - begin)) // 2
        first, last = max(begin - reach, 0), min(end + reach, flat.size)
        share = float(counts[last] - counts[first]) / (last - first)
        if end - begin >= MIN_FLAT and (end - begin) * np.log(share) < np.log(limit):
            stretches.append((begin, end + 2))
    return stretches


def outliers(x: Array) -> tuple[list[tuple[int, int]], list[tuple[int, float]]]:
    """Find samples of a read-out that are apart from those about them.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The read-out, nan where samples are missing.

    Returns
    -------
    spikes : list of tuple
        First sample and end of each stretch of samples that are off.
    jumps : list of tuple
        Sample at which the read-out jumps, and by how much.
    """
    if x.size < 3 * WINDOW:
        return [], []
    curvature = np.diff(x, 2)
    size = np.abs(curvature)
    known = np.nan_to_num(size, nan=np.inf)
    medians = np.median(known[: size.size // WINDOW * WINDOW].reshape(-1, WINDOW), axis=1)
    step = float(np.min(size[size > _rounding(x)], initial=np.nanmax(size)))  # of a channel that is rounded
    floor = max(LIMIT * FLOOR * float(np.median(medians)), MAX_STEPS * step)
    nearest = np.minimum(np.arange(size.size) // WINDOW, medians.size - 1)
    candidates = np.flatnonzero(size > np.maximum(LIMIT / 2 * medians, floor)[nearest])
    centres = np.clip(candidates - WINDOW // 2, 0, size.size - WINDOW)
    apart = np.zeros(size.size, dtype=bool)
    apart[candidates] = size[candidates] > LIMIT * np.median(
        sliding_window_view(known, WINDOW)[centres], axis=1
    )
    spikes: list[tuple[int, int]] = []
    jumps: list[tuple[int, float]] = []
    closed = scipy.ndimage.binary_closing(apart, np.ones(5, dtype=bool)) | apart
    for begin, end in derivatives.true_runs(closed).tolist():
        part = np.nan_to_num(curvature[max(begin - 2, 0) : end + 2])
        if begin < 2 or end > size.size - 2:  # of a sample at either end
            spikes.append((begin, end + 2))
            continue
        if abs(part.sum()) > 0.2 * np.abs(part).max():
            continue  # a kink: an injection begins or ends
        moment = float((np.arange(part.size) - (part.size - 1) / 2) @ part)
        width = abs(moment) / np.abs(part).max()
        if width > MAX_WIDTH:
            continue  # motion: a loop follows its guidance
        if width > 0.5:
            jumps.append(((begin + end) // 2 + 1, -moment))
        else:
            spikes.append((begin, end + 2))
    return spikes, jumps
