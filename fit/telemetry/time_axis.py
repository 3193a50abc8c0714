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


@dataclass(frozen=True)
class Stamps:
    """The time column of a table.

    Attributes
    ----------
    seconds : ndarray, shape (N,)
        Time since the first sample [s].
    resolution : float
        What the last digit stands for [s].
    is_single : bool
        Whether that is the spacing of numbers in single precision.
    t0 : str or None
        UTC of the first sample, ISO 8601; None where the column counts from anywhere.
    start : float
        The first sample of a column that counts from anywhere [s].
    """

    seconds: Array
    resolution: float
    is_single: bool
    t0: str | None = None
    start: float = 0.0


def check_time(place: str, time: Array, fs: float, resolution: float = 0.0) -> Array:
    """Return a time axis [s] with steps of 1/fs, exact where single precision has rounded it.

    Parameters
    ----------
    place : str
        File and dataset, for messages.
    time : ndarray, shape (N,)
        As it is stored.
    fs : float
        Sample rate [Hz].
    resolution : float
        What the last digit of the times stands for [s]; a message is about a larger fault, if there is one.

    Raises
    ------
    InputError
        If it is not uniform, or rounding leaves samples that coincide.
    """
    check_finite(place, time)
    # A jitter of a thousandth of a sample, and a clock right to 1e-6, leave every estimate where it is.
    steps = np.diff(time)
    jitter = np.abs(steps * fs - 1)
    if jitter.max() > 1e-3:
        if (exact := _exact(place, time, fs)) is not None:
            return exact
        if np.ptp(steps) * fs <= 2e-3:
            raise InputError(f"{place}: steps of {steps[0]:g} s, expected 1/fs = {1 / fs:g} s")
        single = float(np.spacing(np.float32(np.abs(time).max()))) if _is_single(time) else 0.0
        rounded = fs * max(single, resolution)
        n = int(np.argmax(jitter > (1e-3 + rounded if jitter.max() > 1e-3 + rounded else 1e-3)))
        raise InputError(
            f"{place}: from {time[n]:.10g} s to {time[n + 1]:.10g} s at sample {n + 1}, "
            f"expected uniform steps of 1/fs = {1 / fs:g} s"
        )
    span, duration = (time.size - 1) / fs, float(time[-1] - time[0])
    if abs(duration - span) > 1e-6 * span + 1e-3 / fs:
        raise InputError(f"{place}: spans {duration:.10g} s, expected (N-1)/fs = {span:.10g} s")
    return time


def _exact(place: str, time: Array, fs: float) -> Array | None:
    """Return the uniform time axis [s] that single precision rounds to this one; None if there is none."""
    if not _is_single(time):
        return None
    step = float(np.spacing(np.float32(np.abs(time).max())))
    start = round(float(time[0]) * fs) / fs
    exact = np.arange(time.size) / fs + (start if abs(start - time[0]) <= step / 2 else time[0])
    if np.any(np.abs(time - exact) > step / 2 * (1 + 1e-9)):
        return None
    if step > 0.5 / fs:
        raise InputError(
            f"{place}: in single precision, in steps of {step:.2g} s at {time[-1]:.6g} s, which do not "
            "resolve "
            f"samples {1 / fs:g} s apart; expected double precision, or seconds since the start of the run"
        )
    return np.asarray(exact, dtype=np.float64)


def _is_single(x: Array) -> bool:
    return bool(np.array_equal(x.astype(np.float32), x))


def check_finite(place: str, values: Array) -> None:
    """Refuse a value that is missing or infinite."""
    if not (finite := np.isfinite(values)).all():
        n = int(np.argmin(finite))
        raise InputError(f"{place}: {values[n]} at sample {n}, expected a finite value")


def fit_grid(place: str, stamps: Stamps, fs: float | None) -> tuple[Array, float]:
    """Return the seconds since the first sample and the rate [Hz], by default the one that fits best.

    The rounding of stamps to their last digit is no jitter: if they are uniform but for that, the exact grid
    is returned.
    """
    seconds = stamps.seconds
    if not seconds[-1] > seconds[0]:
        _check_resolution(place, stamps, abs(float(seconds[-1] - seconds[0])))
        raise InputError(f"{place}: from {seconds[0]:g} s to {seconds[-1]:g} s, expected it to increase")
    _refuse_absent_rows(place, seconds)
    rates = [fs] if fs is not None else _rates(seconds, stamps.resolution)
    for rate in rates:
        even = np.arange(seconds.size) / rate
        try:
            time = check_time(place, seconds, rate)
        except InputError:
            if _is_rounded(seconds - even, stamps.resolution, rate):
                return even, rate
        else:
            return (np.asarray(time) if stamps.t0 is None else even), rate
    _check_resolution(place, stamps, 0.5 / rates[0])
    return np.asarray(check_time(place, seconds, rates[0], resolution=stamps.resolution)), rates[0]


def _refuse_absent_rows(place: str, seconds: Array) -> None:
    """Refuse times that are uniform but for steps of several samples."""
    steps = np.diff(seconds)
    step = float(np.median(steps))
    if not step > 0:
        return
    rows = np.round(steps / step)
    uniform = np.abs(steps - rows * step) <= 1e-2 * step
    absent = int((rows - 1).sum())
    if uniform.all() and rows.min() >= 1 and absent:
        n = int(np.argmax(rows > 1))
        raise InputError(
            f"{place}: {absent} row{'s are' if absent > 1 else ' is'} absent, first after sample {n} "
            f"({seconds[n]:.10g} s); expected a row for each sample, with empty cells, nan or a marker "
            "(missing = -9999 in the map) where values are missing"
        )


def _is_rounded(off: Array, digit: float, rate: float) -> bool:
    """Return whether times are `off` a uniform grid by no more than their last digit.

    It must be finer than half a sample, so that one sample too many or too few shows. A clock may be wrong by
    1e-6, as elsewhere.
    """
    n = np.arange(off.size)
    slope = float(np.polyfit(n, off, 1)[0])
    if abs(slope) * rate <= CLOCK_ERROR:
        off = off - slope * n
    return digit <= 0.5 / rate and bool(np.ptp(off) <= 1.1 * digit + 1e-3 / rate)


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
    digit = min(max(stamps.resolution, reference.resolution, 1e-3 * step), 0.5 * step)
    n, mean = int(np.argmax(np.abs(late) > digit)), float(late.mean())  # in the mean, rounding averages out
    if abs(late[n]) > digit or abs(mean) > max(AGREEMENT, 1e-3 * step):
        off, which = (float(late[n]), f"sample {n}") if abs(late[n]) > digit else (mean, "on average")
        raise InputError(f"{place}: {which} {abs(off):.3g} s {_order(off)} {other_place}, {expected}")


def check_start(place: str, stated: str, stamps: Stamps, fs: float) -> None:
    """Refuse a stated start that is more than a sample off the first time stamp; `place` is that of t0."""
    if stamps.t0 is None:
        return
    off = (utc(stated) - utc(stamps.t0)).total_seconds()
    if abs(off) > 1 / fs:
        raise InputError(
            f"{place}: {stated!r} is {abs(off):.10g} s {_order(off)} the first time stamp, "
            f"{stamps.t0!r}, expected the same, or none: it follows from the time stamps"
        )


def _order(off: float) -> str:
    return "before" if off < 0 else "after"


def _rates(seconds: Array, digit: float) -> list[float]:
    """Return sample rates [Hz] to try: round ones, those of round periods, the mean, and the best fit."""
    span = float(seconds[-1])
    mean = (seconds.size - 1) / span
    tolerance = max(CLOCK_ERROR, 2 * digit / span)
    spelt = [f"{{:.{digits}g}}" for digits in range(1, 6)]
    candidates = (rate for s in spelt for rate in (float(s.format(mean)), 1 / float(s.format(1 / mean))))
    rates = [rate for rate in candidates if math.isclose(rate, mean, rel_tol=tolerance)]
    slope = float(np.polyfit(np.arange(seconds.size), seconds, 1)[0])
    return [*dict.fromkeys(rates[:2]), mean, *([1 / slope] if slope > 0 else [])]


def _check_resolution(place: str, stamps: Stamps, largest: float) -> None:
    """Refuse single precision whose last digit is worth more than `largest` [s]."""
    if stamps.is_single and stamps.resolution > largest:
        raise InputError(
            f"{place}: kept in single precision, the time stamps have lost their digits: they are rounded to "
            f"{stamps.resolution:g} s, expected double precision, or no [time] but attributes fs and t0"
        )
