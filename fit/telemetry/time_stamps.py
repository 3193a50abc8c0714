"""Time stamps of archives: when a run starts, and the seconds since then.

Calendars, scales and leap seconds are those of `astropy.time`. A stamp has a last digit, its resolution: it
may be off by that much, and the samples be uniform all the same.

Every function raises `fit.errors.InputError`; its message names the place and what was expected.
"""

import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, timedelta
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, quote
from fit.telemetry.contract import utc
from fit.telemetry.maps import SECONDS, Format, Scale
from fit.telemetry.time_axis import Stamps, check_finite

if TYPE_CHECKING:
    from astropy.time import Time

Array = NDArray[np.float64]

_UNIX_EPOCH = 40587  # MJD of 1970-01-01
_FIRST_MJD, _LAST_MJD = 36934.0, 88069.0  # MJD of 1960, when UTC began, and of 2100
_DAY = 86400.0  # s
_WEEK = 604800.0  # s
_CLOCK = r"\d\d:\d\d(?::\d\d(?:[.,](?P<digits>\d*))?)?"
_ZONE = r"\s*(?:Z|UTC|[+-]00:?00)?"
_TEXTS = {  # with the format of astropy that each is turned into
    "isot": re.compile(rf"(?P<day>\d{{4}}([-/])\d\d\2\d\d)[T ]\s*(?P<clock>{_CLOCK}){_ZONE}"),
    "yday": re.compile(rf"(?P<day>\d{{4}}[:-]\d{{3}})[T :]\s*(?P<clock>{_CLOCK}){_ZONE}"),
}
_EXAMPLES = {"isot": "2016-04-16T14:00:00.000Z", "yday": "2016:107:14:00:00.000"}
_EXPECTED = (
    'expected "2016-04-16T14:00:00Z" (format = "iso"), "2016:107:14:00:00" ("yday"), or numbers with format '
    '= "gps", "unix", "mjd" or "jd" in [time]'
)


def read_elapsed(place: str, values: Array, factor: float) -> Stamps:
    """Read a column of seconds that count from anywhere, in units of `factor` seconds."""
    check_finite(place, values)
    digit, is_single = _resolution(values)
    start = float(values[0] * factor) if values.size else 0.0
    return Stamps(np.asarray((values - values[:1]) * factor), digit * factor, is_single, start=start)


def since(place: str, epoch: str, elapsed: Stamps) -> Stamps:
    """Return times that count from an epoch, by default from anywhere, in days of 86400 s."""
    if not epoch or not elapsed.seconds.size:
        return elapsed
    try:
        t0 = utc(epoch.removesuffix("UTC").strip()) + timedelta(seconds=elapsed.start)
    except (ValueError, OverflowError):
        raise InputError(f"{place}: since {quote(epoch)}, expected an epoch in ISO 8601") from None
    return replace(elapsed, t0=t0.astimezone(UTC).isoformat().replace("+00:00", "Z"))


def read_numbers(place: str, values: Array, format_: Format, scale: Scale | None, factor: float) -> Stamps:
    """Read time stamps that are numbers; of a format that counts seconds, in units of `factor` seconds."""
    if format_ in _FORMATS_OF_TEXT:
        example = _EXAMPLES[_FORMATS_OF_TEXT[format_]]
        raise InputError(f"{place}: numbers, expected texts of format {format_!r} such as {example!r}")
    check_finite(place, values)
    if not values.size:
        return Stamps(values, 0.0, is_single=False)
    digit, is_single = _resolution(values)
    digit *= factor if format_ in SECONDS else _DAY
    with _astropy():
        stamps = _since_first(place, _instants(place, values * factor, format_, scale), digit)
    seconds = _remove_step(values * factor, stamps.seconds) if format_ == "unix" else stamps.seconds
    return replace(stamps, seconds=seconds, is_single=is_single)


def read_texts(
    place: str, cells: Sequence[str], format_: Format | None, scale: Scale | None, factor: float
) -> Stamps:
    """Read time stamps that are texts; without a `format_`, that of the first."""
    if format_ is not None and format_ not in _FORMATS_OF_TEXT:
        return read_numbers(place, _numbers(place, cells), format_, scale, factor)
    if not cells:
        return Stamps(np.zeros(0), 0.0, is_single=False)
    known = _FORMATS_OF_TEXT[format_] if format_ else format_of(cells[0])
    if known is None:
        raise InputError(f"{place}: {quote(cells[0])} at sample 0, texts of no known format, {_EXPECTED}")
    with _astropy():
        return _since_first(place, _parsed(place, cells, known, scale), _last_digit(cells))


_FORMATS_OF_TEXT = {"iso": "isot", "isot": "isot", "yday": "yday"}


@contextmanager
def _astropy() -> Iterator[None]:
    """Let astropy neither look for newer leap seconds in the network nor warn of years to come."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that there is no folder for its settings
        from astropy.utils.iers import conf  # takes its time to be read in

    with conf.set_temp("auto_download", False), warnings.catch_warnings():
        warnings.filterwarnings("error", message="ERFA function")  # such as a minute of 61 s
        warnings.filterwarnings("ignore", message=".*dubious year")
        warnings.filterwarnings("ignore", message=".*leap-second")
        yield


def _since_first(place: str, instants: "Time", resolution: float) -> Stamps:
    """Return the time since the first stamp; the last digit stands for `resolution` [s]."""
    seconds = np.asarray((instants - instants[0]).to_value("s"), dtype=np.float64)
    digits = min(max(math.floor(1e-9 - math.log10(resolution)), 0), 6)
    start = instants[0].utc.copy(format="isot")
    start.precision = digits
    whole, _, fraction = str(start.value).partition(".")
    fraction = fraction.rstrip("0")
    t0 = f"{whole}.{fraction}Z" if fraction else f"{whole}Z"
    if whole.endswith(":60"):
        raise InputError(
            f"{place}: begins within a leap second, at {t0}, expected a run that begins after it"
        )
    return Stamps(seconds, resolution, is_single=False, t0=t0)


def _instants(place: str, values: Array, format_: Format, scale: Scale | None) -> "Time":
    """Return the instants that numbers of a format stand for."""
    from astropy.time import Time, TimeDelta

    if format_ == "unix":  # astropy's own has days of one length, but a POSIX clock steps
        days = np.floor(values / _DAY)
        _check_range(place, values, _UNIX_EPOCH + days, format_)
        midnight = Time(_UNIX_EPOCH + days, format="mjd", scale="utc")
        return midnight.tai + TimeDelta(values - days * _DAY, format="sec")
    if format_ in SECONDS:
        epoch = Time(0.0, format=format_)
        _check_range(place, values, epoch.mjd + values / _DAY, format_)
        return epoch + TimeDelta(values, format="sec")
    _check_range(place, values, values - (2400000.5 if format_ == "jd" else 0.0), format_)
    return Time(values, format=format_, scale=scale or "utc")


def _check_range(place: str, values: Array, mjd: Array, format_: str) -> None:
    if format_ == "gps" and values.size and values.max() <= _WEEK:
        raise InputError(
            f"{place}: {values[0]:.16g} at sample 0, seconds of a GPS week; expected seconds since "
            "1980-01-06, week * 604800 + second of the week"
        )
    out_of_range = ~((mjd >= _FIRST_MJD) & (mjd < _LAST_MJD))
    if out_of_range.any():
        n = int(np.argmax(out_of_range))
        raise InputError(
            f"{place}: {values[n]:.16g} at sample {n}, expected a time of format {format_!r}, 1960 to 2100"
        )


def _numbers(place: str, cells: Sequence[str]) -> Array:
    values = []
    for n, cell in enumerate(cells):
        try:
            values.append(float(cell))
        except ValueError:
            raise InputError(f"{place}: {quote(cell)} at sample {n}, expected a number") from None
    return np.array(values)


def format_of(cell: str) -> str | None:
    """Return the format of a text that is a time stamp, None if it is none."""
    return next((name for name, pattern in _TEXTS.items() if pattern.fullmatch(cell.strip())), None)


def _parsed(place: str, cells: Sequence[str], format_: str, scale: Scale | None) -> "Time":
    """Return the instants of texts."""
    hyphen, separator = ("-", "T") if format_ == "isot" else (":", ":")
    spelt: list[str] = []
    for cell in cells:
        m = _TEXTS[format_].fullmatch(cell.strip())
        if m is None:
            raise _no_stamp(place, cells, len(spelt), format_)
        day = m["day"].replace("/", "-").replace("-", hyphen)
        spelt.append(f"{day}{separator}{m['clock'].replace(',', '.')}")
    try:
        return _time(spelt, format_, scale)
    except (ValueError, Warning):
        for n, stamp in enumerate(spelt):
            try:
                _time([stamp], format_, scale)
            except (ValueError, Warning):
                raise _no_stamp(place, cells, n, format_) from None
        raise


def _time(spelt: Sequence[str], format_: str, scale: Scale | None) -> "Time":
    from astropy.time import Time

    times = Time(spelt, format=format_, scale=scale or "utc")
    if not np.all((times.mjd >= _FIRST_MJD) & (times.mjd < _LAST_MJD)):
        raise ValueError("years outside 1960 to 2100")
    return times


def _no_stamp(place: str, cells: Sequence[str], n: int, format_: str) -> InputError:
    expected = f"expected a time stamp such as {_EXAMPLES[format_]!r}"
    return InputError(f"{place}: {quote(cells[n])} at sample {n}, {expected}")


def _last_digit(cells: Sequence[str]) -> float:
    """Return what the last digit of time stamps stands for [s]."""
    longest = max((cell.strip() for cell in cells), key=len)
    match = next(m for m in (pattern.fullmatch(longest) for pattern in _TEXTS.values()) if m)
    if match["clock"].count(":") == 1:
        return 60.0
    return float(10.0 ** -len(match["digits"] or ""))


def _resolution(values: Array) -> tuple[float, bool]:
    """Return what the last digit of numbers stands for, and whether it is that of single precision."""
    largest = np.abs(values).max(initial=0.0)
    spacing = float(np.spacing(largest))
    digit = next(
        (
            10.0**-n
            for n in range(16)
            if np.all(np.abs(values * 10.0**n - np.round(values * 10.0**n)) <= 4 * spacing * 10.0**n)
        ),
        spacing,
    )
    with np.errstate(over="ignore"):
        coarse = values.astype(np.float32)
    single = float(np.spacing(np.float32(largest))) if np.array_equal(values, coarse) else 0.0
    return max(digit, spacing, single), single > digit


def _remove_step(unix: Array, seconds: Array) -> Array:
    """Return seconds without the leap second that a POSIX clock counts twice, before midnight or after it."""
    steps = np.diff(seconds)
    usual = float(np.median(steps)) if steps.size else 0.0
    early, late = (np.flatnonzero(np.abs(steps - usual - offset) < 0.01) + 1 for offset in (-1.0, 1.0))
    if early.size != 1 or late.size != 1:
        return seconds
    begin, end = sorted((int(early[0]), int(late[0])))
    to_midnight = (unix[[begin, end]] + _DAY / 2) % _DAY - _DAY / 2
    if np.any(np.abs(to_midnight) > 1.5):
        return seconds
    steady = seconds.copy()
    steady[begin:end] -= 1.0 if late[0] < early[0] else -1.0
    return steady
