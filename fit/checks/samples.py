"""Samples of one channel that no instrument gives: constant, or on a straight line.

It shows in the channel alone, at the rate of its archive, by its differences. Commands are constant where no
loop feeds them back, and may jump.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.campaign import Campaign
from fit.false_alarms import p_limit
from fit.findings import Finding
from fit.spacecraft import saturation, spacecraft_of
from fit.spectra import derivatives
from fit.whitening import Experiment

Array = NDArray[np.float64]

MIN_FLAT = 8  # second differences in a row that are zero: a stretch
NEARBY = 2000  # samples about a stretch that show how often noise and rounding make a difference zero
MAX_SHARE = 0.01  # of differences that are zero, beyond those that rounding makes
CHANCE_FACTOR = 5.0  # times that share of a run, in its quiet parts
COARSE = 0.1  # share of differences that rounding makes zero, from which nothing is said
MIN_NOISE = 0.5  # of fifth over fourth differences: noise has 1.5, a sine 2 pi f / fs
MAX_ROUNDING = 16  # times that of a second difference in a fifth one, with margin


def is_noisy(x: Array | None) -> bool:
    """Return whether a channel changes nearly always, as noise makes it."""
    return x is not None and int(np.count_nonzero(x[1:] == x[:-1])) < 0.5 * (x.size - 1)


def find(campaign: Campaign) -> list[Finding]:
    """Return where channels that should be noise are constant or on a straight line.

    Read-outs should be, and commands that are in the noise run; at a limit they are masked, and no fault.
    """
    n_channels = sum(len(run.channels.series) for e in campaign.usable for run in e.runs)
    return campaign.find_each(lambda e: _of_experiment(e, n_channels))


def _of_experiment(e: Experiment, n_channels: int) -> Iterator[Finding]:
    commands = [
        name
        for name in e.sysid.spacecraft.commands
        if e.noise and name in e.sysid.channels.series and is_noisy(e.noise.telemetry.channels.get(name))
    ]
    for run in (run.telemetry for run in e.runs):
        limits = spacecraft_of(run).limits(run)
        for name in (*e.sysid.spacecraft.read_outs, *(name for name in commands if name in run.channels)):
            x = run.channels[name]
            if name in limits:
                x = np.where(saturation.at_limit(x, limits[name]), np.nan, x)
            for code, words in _flat_faults(x, run.fs, n_channels) if np.isfinite(x).any() else ():
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
    if flat.all():
        return
    least_noise = max(MIN_NOISE * np.nanmedian(fourth), MAX_ROUNDING * rounding) if fifth.size else 0.0
    # that rounding makes a difference zero, if the least of them is a step of it
    chance = float(np.nanmin(size[~flat]) / np.nanmedian(size[~flat]))
    if chance > COARSE or (fifth.size and not np.nanmedian(fifth) > least_noise):
        return
    stretches = _stretches(flat, p_limit(n_channels * x.size))
    for begin, end in stretches:
        seconds = (end - begin) / fs
        words = f"is constant or a straight line for {seconds:g} s at {begin / fs:.7g} s"
        yield "invalid_data", words
    share = float(np.mean(flat))
    if not stretches and share > MAX_SHARE + CHANCE_FACTOR * chance:
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
        start, stop = max(begin - reach, 0), min(end + reach, flat.size)
        share = float(counts[stop] - counts[start]) / (stop - start)
        if end - begin >= MIN_FLAT and (end - begin) * np.log(share) < np.log(limit):
            stretches.append((begin, end + 2))
    return stretches
