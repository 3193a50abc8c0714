"""Samples of a read-out that are apart from those about them: spikes are masked, jumps are faults.

A body does not jump: a read-out that does is at fault whatever the forces. It shows in the second differences
of the channel alone, at the rate of its archive.
"""

from collections.abc import Iterator

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.findings import Finding
from fit.spectra import derivatives
from fit.whitening import Experiment

Array = NDArray[np.float64]

WINDOW = 31  # second differences that show the noise around one
LIMIT = 30.0  # their medians, from which a second difference is apart: noise and motion make up to 15
FLOOR = 0.1  # of the median of all second differences: least noise
MAX_STEPS = 4.0  # of rounding, up to which nothing is apart
MAX_WIDTH = 2.6  # samples of a jump: an anti-alias filter makes up to 2.3, a loop that follows its guidance 3


def find(campaign: Campaign) -> list[Finding]:
    """Return spikes and jumps of the read-outs of all experiments."""
    return campaign.find_each(_of_experiment)


def _of_experiment(e: Experiment) -> Iterator[Finding]:
    for run in e.runs:
        telemetry, flags = run.telemetry, np.zeros(run.telemetry.size, dtype=bool)
        for name in run.spacecraft.read_outs:
            spikes, jumps = outliers(telemetry.channels[name])
            for begin, end in spikes:
                flags[begin:end] = True
            for sample, size in jumps[:1]:
                words = f"{name} jumps by {size:.2g} m at {sample / telemetry.fs:.7g} s"
                yield Finding("invalid_data", f"{telemetry.path}: {words}", telemetry.run, name)
        if flags.any():
            spans = run.spans(flags)
            places = ", ".join(f"{begin:.0f} s" for begin, _ in spans)
            plural = "s" * (len(spans) > 1)
            message = f"{telemetry.run}: {len(spans)} spike{plural} masked, at {places}"
            yield Finding("glitches", message, telemetry.run, spans=spans)


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
    rounding = 4 * float(np.spacing(np.nanmax(np.abs(x))))  # of double precision
    size = np.abs(curvature)
    known = np.nan_to_num(size, nan=np.inf)
    medians = np.median(known[: size.size // WINDOW * WINDOW].reshape(-1, WINDOW), axis=1)
    step = float(np.min(size[size > rounding], initial=np.nanmax(size)))  # of a channel that is rounded
    floor = max(LIMIT * FLOOR * float(np.median(medians)), MAX_STEPS * step)
    nearest = np.minimum(np.arange(size.size) // WINDOW, medians.size - 1)
    candidates = np.flatnonzero(size > np.maximum(LIMIT / 2 * medians, floor)[nearest])
    centres = np.clip(candidates - WINDOW // 2, 0, size.size - WINDOW)
    is_outlier = np.zeros(size.size, dtype=bool)
    is_outlier[candidates] = size[candidates] > LIMIT * np.median(
        sliding_window_view(known, WINDOW)[centres], axis=1
    )
    spikes: list[tuple[int, int]] = []
    jumps: list[tuple[int, float]] = []
    closed = scipy.ndimage.binary_closing(is_outlier, np.ones(5, dtype=bool)) | is_outlier
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
