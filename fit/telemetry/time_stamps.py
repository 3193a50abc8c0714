"""Time stamps of archives: when a run starts, and the seconds since then.

Calendars, scales and leap seconds are those of `astropy.time`. A stamp has a last digit, its resolution: it
may be off by that much, and the samples be uniform all the same.
"""

import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, quote
from fit.telemetry.contract import utc
from fit.telemetry.maps import SECONDS, Format, Scale
from fit.telemetry.time_axis import Stamps, check_finite, resolution

if TYPE_CHECKING:
    from astropy.time import Time

Array = NDArray[np.float64]

_TEXT = re.compile(
    r"(?P<day>\d{4}(?:([-/])\d\d\2\d\d|[-:]\d{3}))[T :]\s*"
    r"(?P<clock>\d\d:\d\d(?::\d\d(?:[.,](?P<digits>\d*))?)?)\s*(?:Z|UTC|[+-]00:?00)?"
)
_EXPECTED = 'expected a time stamp such as "2016-04-16T14:00:00.000Z" or "2016:107:14:00:00.000"'
_TEXTS = ("iso", "isot", "yday")  # formats
_YEARS = (1990, 2100)  # seconds of a GPS week would be in 1980
_POSIX_EPOCH = "1970-01-01"
_DAY = 86400.0  # s


def read_stamps(
    place: str,
    values: NDArray[Any],
    format_: Format | None,
    scale: Scale | None,
    factor: float,
    epoch: str = "",
) -> Stamps:
    """Read a column of times.

    Parameters
    ----------
    place : str
        File and column, for messages.
    values : ndarray, shape (N,)
        Numbers, or texts as objects.
    format_, scale : str or None
        As in `astropy.time`; without a format, texts are ISO 8601 or have the day of the year, and numbers
        count from `epoch`.
    factor : float
        Unit of numbers that count seconds [s].
    epoch : str
        ISO 8601; empty for times that count from anywhere. Its days have 86400 s.

    Raises
    ------
    InputError
        If a value is no such time.
    """
    is_text = values.dtype == object
    if format_ is not None and is_text is not (format_ in _TEXTS):
        content = "texts" if is_text else "numbers"
        raise InputError(f"{place}: {content}, expected times of format {format_!r}")
    if is_text:
        return _read_texts(place, values.tolist(), scale)
    check_finite(place, values)
    if not values.size:
        return Stamps(values, 0.0)
    digit = resolution(values)
    with _astropy():
        if format_ and format_ not in SECONDS:
            seconds, start_time = _elapsed(place, values, format_, scale)
            digit *= _DAY
        else:
            seconds, digit, start = (values - values[0]) * factor, digit * factor, float(values[0] * factor)
            if format_ == "unix":
                epoch = _POSIX_EPOCH  # astropy stretches its days over leap seconds
            if format_ is None and not epoch:
                return Stamps(seconds, digit, start=start)
            start_time = _after_epoch(place, epoch, start) if epoch else _time(start, format_)
        return Stamps(seconds, digit, _spelt(place, start_time, digit, format_))


def _read_texts(place: str, cells: Sequence[str], scale: Scale | None) -> Stamps:
    matches = [_TEXT.fullmatch(cell.strip()) for cell in cells]
    if None in matches:
        n = matches.index(None)
        raise InputError(f"{place}: {quote(cells[n])} at sample {n}, {_EXPECTED}")
    stamps = [m for m in matches if m]
    if not stamps:
        return Stamps(np.zeros(0), 0.0)
    has_seconds = any(m["clock"].count(":") == 2 for m in stamps)
    digit = 10.0 ** -max(len(m["digits"] or "") for m in stamps) if has_seconds else 60.0
    is_day_of_year = len(stamps[0]["day"]) == len("2016-107")
    mark, separator, format_ = (":", ":", "yday") if is_day_of_year else ("-", "T", "isot")
    spelt = [f"{re.sub('[-/:]', mark, m['day'])}{separator}{m['clock'].replace(',', '.')}" for m in stamps]
    with _astropy():
        seconds, start_time = _elapsed(place, spelt, format_, scale)
        return Stamps(seconds, digit, _spelt(place, start_time, digit, format_))


def _elapsed(place: str, values: object, format_: str, scale: Scale | None) -> tuple[Array, "Time"]:
    """Return the seconds since the first of the times, and this one."""
    try:
        times = _time(values, format_, scale or "utc")
        return np.asarray((times - times[0]).to_value("s")), times[0]
    except (ValueError, Warning) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{place}: {reason[:200]}, expected times of format {format_!r}") from error


def _time(values: object, format_: str | None, scale: str | None = None) -> "Time":
    from astropy.time import Time  # takes its time

    return Time(values, format=format_, scale=scale)


def _after_epoch(place: str, epoch: str, start: float) -> "Time":
    """Return the instant that is so many seconds [s] after an epoch."""
    try:
        return _time(utc(epoch.removesuffix("UTC").strip()) + timedelta(seconds=start), None)
    except (ValueError, OverflowError):
        raise InputError(f"{place}: since {quote(epoch)}, expected an epoch in ISO 8601") from None


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


def _spelt(place: str, time: "Time", digit: float, format_: str | None) -> str:
    """Return a start in ISO 8601, rounded to the last digit of the stamps."""
    start = time.utc.copy(format="isot")
    start.precision = min(max(math.floor(1e-9 - math.log10(digit)), 0), 6)
    whole, _, fraction = str(start.value).partition(".")
    if whole.endswith(":60"):
        raise InputError(f"{place}: begins within a leap second, at {whole}, expected a run that does not")
    begin, end = _YEARS
    if not begin <= int(whole[:-15]) < end:
        raise InputError(
            f"{place}: begins at {whole}, expected times of format {format_ or 'iso'!r}, {begin} to {end}"
        )
    fraction = fraction.rstrip("0")
    return f"{whole}.{fraction}Z" if fraction else f"{whole}Z"
