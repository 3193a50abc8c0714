"""Values of a campaign file that are more than a quantity: whole samples, frequencies, times in UTC."""

import math
from datetime import UTC, datetime, timedelta
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from fit.errors import quote
from fit.files import problem
from lpfcosim.campaign.units import YEAR, Frequency, Quantity
from lpfcosim.spacecraft import FS, LONGEST_DELAY, H

_RATES = (1.0, 2.0, 5.0, 10.0)  # Hz, at which telemetry may be recorded


def _whole_samples(seconds: float) -> float:
    samples = round(seconds * FS)
    if abs(seconds * FS - samples) > 1e-6:
        raise problem(f"{seconds:g} s is not a whole number of {H:g} s samples")
    if samples == 0 and seconds > 0:
        raise problem(f"{seconds:g} s is less than a sample, {H:g} s")
    return samples / FS


def _below_nyquist(frequency: float) -> float:
    if frequency >= FS / 2:
        raise problem(f"{frequency:g} Hz is not below the Nyquist frequency, {FS / 2:g} Hz")
    return frequency


def _recorded(rate: float) -> float:
    if rate not in _RATES:
        raise problem(f"{rate:g} Hz is no rate to record at, choose 1, 2, 5 or 10 Hz")
    return rate


def _utc(raw: object) -> datetime:
    try:
        when = raw if isinstance(raw, datetime) else datetime.fromisoformat(str(raw))
    except ValueError:
        when = datetime.min
    if when.utcoffset() != timedelta(0) or not 1990 <= when.year < 2100:
        raise problem(f'{quote(raw)} is not a time in UTC, write it as in "2016-04-16T08:00:00Z"')
    return when.astimezone(UTC)


def _parameter_value(raw: object) -> object:
    if isinstance(raw, bool | int | str) or (isinstance(raw, float) and math.isfinite(raw)):
        return raw
    raise problem(f"{quote(raw)}, expected a finite number, a string, true or false")


ParameterValue = Annotated[bool | int | float | str, BeforeValidator(_parameter_value)]
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Gain = Annotated[Number, Field(ge=0.01, le=100)]
ForceGain = Annotated[Number, Field(gt=0.7, lt=1.5)]  # beyond, a fit takes it for a wrong sign or unit
Duration = Annotated[
    float, Quantity("a time", "s", "6 h", "not negative", largest=YEAR), AfterValidator(_whole_samples)
]
Delay = Annotated[float, Quantity("a delay coefficient", "s", "0.186 s", "positive", largest=LONGEST_DELAY)]
BelowNyquist = Annotated[Frequency, AfterValidator(_below_nyquist)]
SampleRate = Annotated[Frequency, AfterValidator(_recorded)]
Utc = Annotated[datetime, BeforeValidator(_utc)]
AlignmentEpoch = Annotated[int, Strict(), Field(ge=1, le=9999)]
InertialPeriod = Annotated[int, Strict(), Field(ge=1, le=9999)]
_Value = TypeVar("_Value")
Swept = Annotated[list[_Value], Field(min_length=2, max_length=1000)]
