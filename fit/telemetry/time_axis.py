"""The time axis of a run: uniform seconds, from those of a telemetry file or the time stamps of archives.

Every function raises `fit.errors.InputError`; its message names the place and what was expected.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.telemetry.contract import utc

Array = NDArray[np.float64]

AGREEMENT = 1e-3  # s, of the clocks of two files: a shift of a channel is one of its delay
CLOCK_ERROR = 1e-6  # of the rate of a clock, which changes no estimate
JITTER = 1e-3  # of a sample, which changes none either
_ROUNDED = 0.45  # of a sample: rounding below leaves a lost sample visible


@dataclass(frozen=True)
class Stamps:
    """The time column of a table.

    Attributes
    ----------
    seconds : ndarray, shape (N,)
        Time since the first sample [s].
    resolution : float
        What the last digit stands for [s].
    t0 : str or None
        UTC of the first sample, ISO 8601; None where the column counts from anywhere.
    start : float
        The first sample of a column that counts from anywhere [s].
    """

    seconds: Array
    resolution: float
    t0: str | None = None
    start: float = 0.0


def resolution(values: Array) -> float:
    """Return what the last digit of numbers stands for, that of single precision if they were kept in it."""
    largest = np.abs(values).max(initial=0.0)
    spacing = float(np.spacing(largest))
    scaled = ((10.0**-n, values * 10.0**n) for n in range(16))
    digits = (d for d, x in scaled if np.all(np.abs(x - np.round(x)) <= 4 * spacing / d))
    with np.errstate(over="ignore"):
        is_single = np.array_equal(values, values.astype(np.float32))
    single = float(np.spacing(np.float32(largest))) if is_single else 0.0
    return max(next(digits, spacing), spacing, single)


def check_time(place: str, time: Array, fs: float, digit: float | None = None) -> Array:
    """Return the exact time axis [s] that a stored one was rounded from, with steps of 1/fs.

    Parameters
    ----------
    place : str
        File and dataset, for messages.
    time : ndarray, shape (N,)
        As it is stored.
    fs : float
        Sample rate [Hz].
    digit : float, optional
        What the last digit of the times stands for [s]; by default that of `time`.

    Raises
    ------
    InputError
        If it is not uniform, or rounding leaves samples that coincide.
    """
    check_finite(place, time)
    digit = resolution(time) if digit is None else digit
    is_resolved = digit <= _ROUNDED / fs
    steps, span = np.diff(time), (time.size - 1) / fs
    off = np.abs(steps * fs - 1) > JITTER + (1.01 * digit * fs if is_resolved else 0.0)
    duration = float(time[-1] - time[0])
    if off.any() or abs(duration - span) > CLOCK_ERROR * span + JITTER / fs + is_resolved * digit:
        digits = 1 / (fs * digit)  # in a sample; a whole number of them is not rounded
        if not is_resolved and abs(digits - max(round(digits), 1)) > JITTER:
            raise InputError(
                f"{place}: the times are rounded to {digit:.3g} s, which does not resolve samples "
                f"{1 / fs:g} s apart, expected double precision, or seconds since the start of the run"
            )
        if not off.any():
            raise InputError(f"{place}: spans {duration:.10g} s, expected (N-1)/fs = {span:.10g} s")
        n = int(np.argmax(off))
        raise InputError(
            f"{place}: from {time[n]:.10g} s to {time[n + 1]:.10g} s at sample {n + 1}, expected uniform "
            f"steps of 1/fs = {1 / fs:g} s, with a row for each sample, be it nan"
        )
    start = round(float(time[0]) * fs) / fs
    return (start if abs(start - time[0]) <= digit / 2 else time[0]) + np.arange(time.size) / fs


def check_finite(place: str, values: Array) -> None:
    """Refuse a value that is missing or infinite."""
    if not (finite := np.isfinite(values)).all():
        n = int(np.argmin(finite))
        raise InputError(f"{place}: {values[n]} at sample {n}, expected a finite value")


def fit_grid(place: str, stamps: Stamps, fs: float | None) -> tuple[Array, float]:
    """Return the seconds since the first sample and the rate [Hz], by default the one that fits best."""
    seconds, digit = stamps.seconds, stamps.resolution
    check_finite(place, seconds)
    rates = [fs] if fs is not None else _rates(seconds, digit)
    for rate in rates[:-1]:
        try:
            return check_time(place, seconds, rate, digit), rate
        except InputError:
            continue
    return check_time(place, seconds, rates[-1], digit), rates[-1]


def _rates(seconds: Array, digit: float) -> list[float]:
    """Return sample rates [Hz] to try: round ones, those of round periods, the mean, that of most steps."""
    span, step = float(seconds[-1]), float(np.median(np.diff(seconds)))
    if not span > 0:
        return [1.0]
    mean = (seconds.size - 1) / span
    tolerance = max(CLOCK_ERROR, 2 * digit / span)
    spelt = [f"{{:.{digits}g}}" for digits in range(1, 6)]
    candidates = (rate for s in spelt for rate in (float(s.format(mean)), 1 / float(s.format(1 / mean))))
    rates = [rate for rate in candidates if math.isclose(rate, mean, rel_tol=tolerance)]
    is_seen = step > 2.5 * digit or math.isclose(step, digit, rel_tol=JITTER)
    return [*dict.fromkeys(rates[:2]), mean, *([1 / step] if is_seen else [])]


def check_agreement(place: str, stamps: Stamps, other_place: str, reference: Stamps) -> None:
    """Refuse the time stamps of one table that are not those of another table of the same run."""
    expected = "expected the same time stamps in all files of a run"
    size = reference.seconds.size
    if stamps.seconds.size != size:
        raise InputError(f"{place}: {stamps.seconds.size} samples, but {other_place} has {size}, {expected}")
    if size < 2:
        return  # too few samples in any case
    off = stamps.start - reference.start
    if stamps.t0 is not None and reference.t0 is not None:
        off = (utc(stamps.t0) - utc(reference.t0)).total_seconds()
    late = off + stamps.seconds - reference.seconds
    step = float(reference.seconds[-1]) / (size - 1)
    digit = min(max(stamps.resolution, reference.resolution, JITTER * step), 0.5 * step)
    n, mean = int(np.argmax(np.abs(late) > digit)), float(late.mean())  # in the mean, rounding averages out
    if abs(late[n]) > digit or abs(mean) > max(AGREEMENT, JITTER * step):
        off, position = (float(late[n]), f"sample {n}") if abs(late[n]) > digit else (mean, "on average")
        raise InputError(f"{place}: {position} {abs(off):.3g} s {_order(off)} {other_place}, {expected}")


def check_start(place: str, stated: str, time_stamp: str, fs: float) -> None:
    """Refuse a stated start that is more than a sample off the first time stamp; `place` is that of t0."""
    off = (utc(stated) - utc(time_stamp)).total_seconds()
    if abs(off) > 1 / fs:
        raise InputError(
            f"{place}: {stated!r} is {abs(off):.10g} s {_order(off)} the first time stamp, {time_stamp!r}, "
            "expected the same, or none: it follows from the time stamps"
        )


def _order(off: float) -> str:
    return "before" if off < 0 else "after"
