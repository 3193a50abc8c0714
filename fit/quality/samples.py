"""Samples of one channel that no instrument gives: stuck, interpolated, repeated, rounded.

All of it shows in the channel alone, at the rate of its archive. Commands are constant where no loop feeds
them back; of these only what noise makes impossible is a fault.

The tests of a channel are a table, `CHECKS`: the first that fires is reported, since a channel that is stuck
is also rounded and repeated. Jumps of read-outs are reported in any case.
"""

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import p_limit
from fit.model import dynamics
from fit.quality import authority, straight
from fit.quality.jumps import SampleFault, jumps
from fit.quality.resolution import Resolution, chance_of_equality, estimate_resolution
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

READ_OUTS = ("o_1", "o_12")
CHANNELS_TESTED = 100  # of a campaign of thirteen experiments with their noise runs
HEAD = 20000  # samples in which values are counted
MIN_DISTINCT = 0.6  # share of different values; fewer are those of a rounded or periodic channel
MIN_LINE = 6  # samples in a row on a straight line, where there is noise
MAX_BETWEEN = 0.1  # share of samples on the line between their neighbours, where noise puts none
SETTLING = 60.0  # s at either end: a loop may start from exact zeros, an archive end on them
NEARBY = 33  # samples whose increments show how likely equal neighbours are
MAX_CHANCE, SAFETY = (
    0.1,
    2.0,
)  # probability up to which equal neighbours are counted, factor on those expected
SMALL_INCREMENTS = 1e-3  # share of the increments that shows how many are about zero
MIN_CHANGES, MAX_STEP = (
    1e-3,
    3.0,
)  # share of samples at which a rounded command changes, and steps of a change
MAX_PERIOD, MIN_TEETH, COMB_SAMPLES = (
    16,
    80,
    8000,
)  # samples between those of a comb, its teeth, samples tested
COMB_RATIO = 0.1  # second differences of a comb that is interpolated, over those of all
CLIPPED = 0.9  # share of second differences that count as they are


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
    """

    x: Array
    fs: float
    resolution: Resolution | None

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

    def throughout(self, text: str) -> list[SampleFault]:
        """Return a fault of all samples."""
        return [SampleFault(text, 0.0, self.x.size / self.fs)]


def is_noisy(x: Array) -> bool:
    """Return whether a channel changes nearly always, as noise makes it."""
    samples = x[:]
    return int(np.count_nonzero(samples[1:] == samples[:-1])) < 0.5 * (samples.size - 1)


def _constant(channel: Channel) -> list[SampleFault]:
    low, high = channel.extremes
    if low == high:
        return channel.throughout(f"is stuck at {low + 0.0:.4g} throughout")
    if not (is_noisy(channel.x) or channel.resolution):
        return channel.throughout("is more often constant than not")
    return []


def _few_values(channel: Channel) -> list[SampleFault]:
    present = channel.head[~np.isnan(channel.head)]
    distinct = np.unique(present).size
    if distinct >= MIN_DISTINCT * present.size:
        return []
    if period := _period(channel.head):
        return channel.throughout(f"comes again every {period / channel.fs:g} s")
    if channel.resolution is None:
        return channel.throughout(f"is rounded: it has {distinct} values in {present.size} samples")
    return []


def _interpolated(channel: Channel) -> list[SampleFault]:
    if channel.resolution is not None:
        return []
    curvature = channel.curvature[:HEAD]
    rounding = 4 * float(np.spacing(np.nanmax(np.abs(channel.head))))
    runs = derivatives.true_runs(curvature <= max(1e-9 * float(np.nanmax(curvature)), rounding))
    length = np.diff(runs, axis=1)
    share = float(np.sum(length[length < MIN_LINE - 2])) / curvature.size
    if share <= MAX_BETWEEN:
        return []
    return channel.throughout(
        f"is interpolated: {100 * share:.0f} % of its samples lie on the line between their neighbours"
    )


def _lines(channel: Channel) -> list[SampleFault]:
    """Return the stretches that are constant or on a straight line."""
    x, fs, resolution = channel.x, channel.fs, channel.resolution
    if resolution is None:
        typical = float(np.nanmedian(channel.curvature[:HEAD]))
        runs = derivatives.true_runs(channel.curvature <= 1e-9 * typical)
        runs = runs[runs[:, 1] - runs[:, 0] >= MIN_LINE - 2] + np.array([0, 2])
    else:
        runs = straight.stretches(x, resolution)
    faults = []
    for begin, end in runs.tolist():
        part = x[begin:end]
        constant = np.ptp(part) <= (2.1 * resolution.at(part).max() if resolution else 0.0)
        verb = "stops at its limit of" if part[0] in channel.extremes else "is stuck at"
        text = f"{verb} {part[0] + 0.0:.4g}" if constant else "is a straight line"
        faults.append(SampleFault(f"{text} for {(end - begin) / fs:g} s", begin / fs, end / fs))
    return faults


def _repeated(channel: Channel) -> list[SampleFault]:
    """Return the samples that equal the one before, if there are more than chance makes (Poisson)."""
    edge, fs = int(SETTLING * channel.fs), channel.fs
    x = channel.x[edge : max(channel.x.size - edge, edge)]
    equal, expected = x[1:] == x[:-1], 0.0
    if channel.resolution is not None:
        chance = _equality_chance(x, channel.resolution)
        equal &= chance < MAX_CHANCE
        expected = SAFETY * float(np.sum(chance[chance < MAX_CHANCE]))
    at = edge + np.flatnonzero(equal) + 1
    if not at.size:
        return []
    expected = expected if channel.resolution else _expected_coincidences(channel.x)
    if scipy.special.pdtrc(at.size - 1, expected) > p_limit("samples", CHANNELS_TESTED):
        return []
    zero, faults = channel.x[at] == 0, []
    for which, verb in ((at[zero], "is exactly 0"), (at[~zero], "repeats a sample")):
        if which.size:
            count = f" {which.size} times, first" * (which.size > 1)
            begin, end = float(which[0]) / fs, float(which[-1]) / fs
            faults.append(SampleFault(f"{verb}{count}", begin, end, is_repetition=True))
    return faults


#: The tests of a channel that should be noise, in the order in which they are reported.
CHECKS: Mapping[str, Callable[[Channel], list[SampleFault]]] = {
    "constant": _constant,
    "few values": _few_values,
    "interpolated": _interpolated,
    "straight lines": _lines,
    "repeated samples": _repeated,
}


def channel_faults(x: Array, fs: float, resolution: Resolution | None) -> list[SampleFault]:
    """Return where a channel that should be noise is constant, on a straight line or repeated.

    Parameters
    ----------
    x : ndarray, shape (N,)
        The channel.
    fs : float
        Its sample rate [Hz].
    resolution : Resolution, optional
        Of its numbers: what that explains is no fault.
    """
    channel = Channel(np.asarray(x[:], dtype=np.float64), fs, resolution)
    if np.isnan(channel.head).all():
        return []
    return next((faults for check in CHECKS.values() if (faults := check(channel))), [])


def _period(x: Array) -> int:
    """Return the period of a channel in samples; 0 if it has none within half of them."""
    starts = np.flatnonzero(x[1 : x.size // 2] == x[0]) + 1
    return next((int(n) for n in starts if np.array_equal(x[n:], x[:-n], equal_nan=True)), 0)


def _equality_chance(x: Array, resolution: Resolution) -> Array:
    """Return the probability that samples are equal to the next one, from how much x moves nearby."""
    increments = np.abs(np.diff(x)) / resolution.at(x[1:])
    mean = scipy.ndimage.uniform_filter1d(np.nan_to_num(increments), NEARBY, mode="nearest")
    return np.where(np.isnan(increments), 1.0, chance_of_equality(mean))


def _expected_coincidences(x: Array) -> float:
    """Return how many neighbours to expect to be equal by chance, from the digits that values have."""
    values, increments = x[np.isfinite(x)], np.abs(np.diff(x))
    largest = float(np.max(np.abs(values)))
    sample = values[: HEAD : HEAD // 200]
    digits = next((d for d in range(5, 16) if all(float(f"{v:.{d}e}") == v for v in sample)), 16)
    digit = 10.0 ** (np.floor(np.log10(largest)) - digits)
    small = float(np.nanquantile(increments[increments > 0], SMALL_INCREMENTS))
    return float(increments.size * SMALL_INCREMENTS * digit / (2 * small))


def interpolated_channels(run: Telemetry) -> Iterator[str]:
    """Yield the channels of which every n-th sample is made from its neighbours.

    Rounding puts samples on the line between their neighbours here and there, hardly ever all of a comb.
    """
    for name in dynamics.CHANNELS:
        if period := _comb_period(run.channels[name][:COMB_SAMPLES]):
            comb = f"one sample in every {period} lies on the line between its neighbours"
            yield f"{run.path}: {name} is interpolated: {comb}"


def _comb_period(x: Array) -> int:
    """Return the period in samples of those that are interpolated; 0 if none are."""
    if not is_noisy(x):
        return 0
    curvature = np.abs(np.diff(x, 2))
    rank = int(CLIPPED * np.count_nonzero(np.isfinite(curvature)))
    curvature = np.fmin(curvature, np.partition(curvature, rank)[rank])  # jumps are in few of the combs
    mean = float(curvature.mean())
    lines = scipy.fft.rfft(curvature)[curvature.size // MAX_PERIOD :]  # slower ones are those of injections
    if np.abs(lines).max() < 0.6 * mean * curvature.size / MAX_PERIOD:
        return 0
    for period in range(2, min(MAX_PERIOD, curvature.size // MIN_TEETH) + 1):
        teeth = curvature[: curvature.size // period * period].reshape(-1, period).mean(axis=0)
        if teeth.min() < COMB_RATIO * mean:
            return period
    return 0


def check_samples(sysid: Telemetry, noise: Telemetry | None) -> Iterator[str]:
    """Yield the faults of the samples of an experiment and of its noise run."""
    commands = [name for name in dynamics.CHANNELS if name not in READ_OUTS]
    fed_back = {name for name in commands if noise is not None and is_fed_back(noise.channels[name])}
    for run in (sysid, noise):
        if run is not None:
            faults = {name: _faults_of(run, fed_back, name) for name in dynamics.CHANNELS}
            begins = [{f.begin for f in of_channel if f.is_repetition} for of_channel in faults.values()]
            common = set.intersection(*begins)  # all channels at once: the archive, and the equation holds
            for name, of_channel in faults.items():
                for fault in (f for f in of_channel if f.begin not in common):
                    yield f"{run.path}: {name} {fault.text} at {fault.begin:.7g} s"


def is_fed_back(x: Array) -> bool:
    """Return whether a loop feeds a command: it changes all the time, if only by the steps of its numbers."""
    if is_noisy(x):
        return True
    resolution = estimate_resolution(x)
    if resolution is None:
        return False
    head = x[:HEAD]
    steps = np.abs(np.diff(head)) / resolution.at(head[1:])
    return bool(
        np.count_nonzero(steps > 0) > MIN_CHANGES * head.size and np.median(steps[steps > 0]) < MAX_STEP
    )


def _faults_of(run: Telemetry, fed_back: Container[str], name: str) -> list[SampleFault]:
    if name not in READ_OUTS and name not in fed_back:
        return []
    x = run.channels[name]
    if name in fed_back and authority.limited(run, name).size:
        # is masked, and no fault of the archive
        x = np.where(authority.at_limit(x[:], authority.limit_of(run, name)), np.nan, x[:])
    resolution = estimate_resolution(x)
    faults = channel_faults(x, run.fs, resolution)
    if name in READ_OUTS:
        faults += jumps(x, run.fs, resolution.largest if resolution else 0.0)
    return faults
