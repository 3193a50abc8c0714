"""Samples of one channel that no instrument gives: stuck, interpolated, repeated, rounded.

All of it shows in the channel alone, at the rate of its archive. Commands are constant where no loop feeds
them back; of these only what noise makes impossible is a fault.

The tests of a channel are a table, `CHECKS`: the earliest that fires is reported, since a channel that is
stuck is also rounded and repeated. Jumps of read-outs and steps that add noise are reported in any case.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.model import dynamics
from fit.quality import saturation, straight
from fit.quality.jumps import SampleFault, jumps
from fit.quality.resolution import Resolution, chance_of_equality, estimate_resolution
from fit.quality.rounding import rounding_faults
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.warnings import Cause

Array = NDArray[np.float64]

READ_OUTS = ("o_1", "o_12")
HEAD = 20000  # samples in which values are counted
MIN_DISTINCT = 0.6  # share of different values; fewer are those of a rounded or periodic channel
MIN_LINE = 6  # samples in a row on a straight line, where there is noise
MAX_INTERPOLATED = 0.01  # share of samples on the line between their neighbours; noise has none
SETTLING = 60.0  # s at either end: a loop may start from exact zeros, an archive end on them
NEARBY = 33  # samples whose increments show how likely equal neighbours are
MAX_CHANCE = 0.1  # probability up to which equal neighbours are counted
CHANCE_ERROR = 2.0  # factor by which the number expected may be too small
MIN_CHANGES, MAX_STEP = (
    1e-3,
    3.0,
)  # share of samples at which a rounded command changes, and steps of a change
#: Warning in place of exclusions if most of the experiments have a fault, by its kind.
CODES: Mapping[str, str] = {
    **dict.fromkeys(
        ("stuck", "period", "few values", "line", "repetition", "jump", "wild sample"), "suspect_samples"
    ),
    "interpolation": "interpolated",
    "coarse rounding": "coarse_quantisation",
    "rounding": "quantisation",
}


@dataclass(frozen=True)
class Channel:
    """A channel that should be noise.

    Attributes
    ----------
    x : ndarray, shape (N,)
        Its samples, nan where they are missing.
    fs : float
        Sample rate [Hz].
    resolution : Resolution, optional
        Of its numbers: what that explains is no fault.
    n_channels : int
        Channels of the campaign that are tested.
    """

    x: Array
    fs: float
    resolution: Resolution | None
    n_channels: int = 1

    @cached_property
    def head(self) -> Array:
        """Its first samples."""
        return self.x[:HEAD]

    @cached_property
    def extremes(self) -> tuple[float, float]:
        """The least and the largest value."""
        return float(np.nanmin(self.x)), float(np.nanmax(self.x))

    @cached_property
    def curvature(self) -> Array:
        """Sizes of its second differences, shape (N - 2,)."""
        return np.abs(np.diff(self.x, 2))

    def throughout(
        self, kind: str, text: str, size: float | None = None, unit: str = "1"
    ) -> list[SampleFault]:
        """Return a fault of all samples."""
        return [SampleFault(kind, text, 0.0, self.x.size / self.fs, size, unit)]


def is_noisy(x: Array) -> bool:
    """Return whether a channel changes nearly always, as noise makes it."""
    return int(np.count_nonzero(x[1:] == x[:-1])) < 0.5 * (x.size - 1)


def _constant(channel: Channel) -> list[SampleFault]:
    low, high = channel.extremes
    if low == high:
        return channel.throughout("stuck", f"is stuck at {low + 0.0:.4g} throughout")
    if not (is_noisy(channel.x) or channel.resolution):
        return channel.throughout("stuck", "is more often constant than not")
    return []


def _few_values(channel: Channel) -> list[SampleFault]:
    present = channel.head[~np.isnan(channel.head)]
    distinct = np.unique(present).size
    if distinct >= MIN_DISTINCT * present.size:
        return []
    if period := _period(channel.head):
        seconds = period / channel.fs
        return channel.throughout("period", f"repeats every {seconds:g} s", seconds, "s")
    if channel.resolution is None:
        text = f"is rounded: it has {distinct} values in {present.size} samples"
        return channel.throughout("few values", text, distinct / present.size)
    return []


def _interpolated(channel: Channel) -> list[SampleFault]:
    if channel.resolution is not None:
        return []
    curvature = channel.curvature[:HEAD]
    rounding = 4 * float(np.spacing(np.nanmax(np.abs(channel.head))))
    runs = derivatives.true_runs(curvature <= max(1e-9 * float(np.nanmedian(curvature)), rounding))
    length = np.diff(runs, axis=1)
    share = float(np.sum(length[length < MIN_LINE - 2])) / curvature.size
    if share <= MAX_INTERPOLATED:
        return []
    text = f"is interpolated: {100 * share:.0f} % of its samples lie on the line between their neighbours"
    return channel.throughout("interpolation", text, share)


def _lines(channel: Channel) -> list[SampleFault]:
    """Return the stretches that are constant or on a straight line."""
    x, fs, resolution = channel.x, channel.fs, channel.resolution
    if resolution is None:
        typical = float(np.nanmedian(channel.curvature[:HEAD]))
        runs = derivatives.true_runs(channel.curvature <= 1e-9 * typical)
        runs = runs[runs[:, 1] - runs[:, 0] >= MIN_LINE - 2] + np.array([0, 2])
    else:
        runs = straight.stretches(x, resolution, p_limit("straight lines", channel.n_channels * x.size))
    faults = []
    for begin, end in runs.tolist():
        part = x[begin:end]
        constant = np.ptp(part) <= (2.1 * resolution.step_at(part).max() if resolution else 0.0)
        verb = "stops at its limit of" if part[0] in channel.extremes else "is stuck at"
        text = f"{verb} {part[0] + 0.0:.4g}" if constant else "is a straight line"
        seconds = (end - begin) / fs
        kind = "stuck" if constant else "line"
        faults.append(SampleFault(kind, f"{text} for {seconds:g} s", begin / fs, end / fs, seconds, "s"))
    return faults


def _repeated(channel: Channel) -> list[SampleFault]:
    """Return the samples that equal the one before, if there are more than chance makes (Poisson)."""
    edge, fs = int(SETTLING * channel.fs), channel.fs
    x = channel.x[edge : max(channel.x.size - edge, edge)]
    is_equal = x[1:] == x[:-1]
    if not is_equal.any():
        return []
    if channel.resolution is None:  # double precision
        largest = max(map(abs, channel.extremes))
        steps = np.spacing(np.maximum(np.abs(x[1:]), 1e-6 * largest))
    else:
        steps = channel.resolution.step_at(x[1:])
    chance = _equality_chance(np.abs(np.diff(x)) / steps)
    repeats = np.flatnonzero(is_equal & (chance < MAX_CHANCE))
    if not repeats.size:
        return []
    # where x moves less than at all of the repeats, chance explains none of them
    expected = CHANCE_ERROR * float(np.sum(chance[chance <= chance[repeats].max()]))
    if scipy.special.pdtrc(repeats.size - 1, expected) > p_limit("repeated samples", channel.n_channels):
        return []
    repeats += edge + 1
    zero, faults = channel.x[repeats] == 0, []
    for samples, verb in ((repeats[zero], "is exactly 0"), (repeats[~zero], "repeats a sample")):
        if samples.size:
            text = verb + f" {samples.size} times, first" * (samples.size > 1)
            begin, end = float(samples[0]) / fs, float(samples[-1]) / fs
            faults.append(SampleFault("repetition", text, begin, end, float(samples.size)))
    return faults


#: The tests of a channel that should be noise, in the order in which they are reported.
CHECKS: Mapping[str, Callable[[Channel], list[SampleFault]]] = {
    "constant": _constant,
    "few values": _few_values,
    "straight lines": _lines,
    "interpolated": _interpolated,
    "repeated samples": _repeated,
}


def channel_faults(
    x: Array, fs: float, resolution: Resolution | None, n_channels: int = 1
) -> list[SampleFault]:
    """Return where a channel that should be noise is constant, on a straight line or repeated.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The channel.
    fs : float
        Its sample rate [Hz].
    resolution : Resolution, optional
        Of its numbers: what that explains is no fault.
    n_channels : int
        Channels of the campaign, which share the budget of false alarms.
    """
    channel = Channel(np.asarray(x, dtype=np.float64), fs, resolution, n_channels)
    if np.isnan(channel.head).all():
        return []
    return next((faults for check in CHECKS.values() if (faults := check(channel))), [])


def _period(x: Array) -> int:
    """Return the period of a channel in samples; 0 if it has none within half of them."""
    starts = np.flatnonzero(x[1 : x.size // 2] == x[0]) + 1
    return next((int(n) for n in starts if np.array_equal(x[n:], x[:-n], equal_nan=True)), 0)


def _equality_chance(increments: Array) -> Array:
    """Return the probability that samples are equal to the next one, from the increments nearby [steps]."""
    mean = scipy.ndimage.uniform_filter1d(np.nan_to_num(increments), NEARBY, mode="nearest")
    return np.where(np.isnan(increments), 1.0, chance_of_equality(mean))


def check_samples(sysid: Telemetry, noise: Telemetry | None, n_channels: int = 1) -> Iterator[Cause]:
    """Yield the faults of the samples of an experiment and of its noise run, of the kinds in `CODES`.

    Parameters
    ----------
    sysid, noise : Telemetry
        The runs.
    n_channels : int
        Channels of the campaign, which share the budget of false alarms.
    """
    commands = [name for name in dynamics.CHANNELS if name not in READ_OUTS]
    noisy = {*READ_OUTS, *(name for name in commands if noise and is_fed_back(noise.channels[name]))}
    for run, reference in ((sysid, noise), (noise, sysid)):
        if run is None:
            continue
        run = run.select(dynamics.CHANNELS)  # which all of the tests read
        resolutions = {name: estimate_resolution(run.channels[name]) for name in dynamics.CHANNELS}
        rounded = {
            name: resolution
            for name, resolution in resolutions.items()
            # a command may have few values because nothing but injections drives it
            if resolution
            and not (resolution.few_values and name in commands and not is_fed_back(run.channels[name]))
        }
        yield from rounding_faults(run, reference, rounded)
        faults = {
            name: _channel_faults(run, name, resolutions[name], n_channels) if name in noisy else []
            for name in dynamics.CHANNELS
        }
        repeats = [{f.begin for f in channel if f.kind == "repetition"} for channel in faults.values()]
        common = set.intersection(*repeats)  # all channels at once: the archive, and the equation holds
        for name, channel in faults.items():
            yield from (fault.as_cause(run, name) for fault in channel if fault.begin not in common)


def is_fed_back(x: Array) -> bool:
    """Return whether a loop feeds a command: it changes all the time, if only by the steps of its numbers."""
    if is_noisy(x):
        return True
    resolution = estimate_resolution(x)
    if resolution is None:
        return False
    head = x[:HEAD]
    steps = np.abs(np.diff(head)) / resolution.step_at(head[1:])
    return bool(
        np.count_nonzero(steps > 0) > MIN_CHANGES * head.size and np.median(steps[steps > 0]) < MAX_STEP
    )


def _channel_faults(
    run: Telemetry, name: str, resolution: Resolution | None, n_channels: int
) -> list[SampleFault]:
    x = run.channels[name]
    if name not in READ_OUTS and saturation.limited(run, name).size:  # is masked, and no fault of the archive
        x = np.where(saturation.at_limit(x, saturation.limit_of(run, name)), np.nan, x)
        resolution = estimate_resolution(x)
    faults = channel_faults(x, run.fs, resolution, n_channels)
    if name in READ_OUTS:
        faults += jumps(x, run.fs, resolution.largest if resolution else 0.0)
    return faults
