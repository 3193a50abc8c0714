"""Numbers that mark missing samples: those that a map states, and those that look like it.

An instrument does not give the same number to the last digit again and again, far outside of all others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.telemetry.contract import CHANNELS

Array = NDArray[np.float64]

#: What archives write for a missing sample, signs aside: nines, and the ends of integers.
USUAL = (*(10.0**n - 1 for n in range(3, 10)), 999.9, 9999.9, *(2.0**n - k for n in (15, 31) for k in (0, 1)))
_HUGE = 1e10  # in any unit of an archive; default fills of netCDF and others are beyond
_DOUBLE = 1e-15  # relative: rounding by a scale that the archive states
_MARKER_RATIO, _NUMBER_RATIO = 5.0, 100.0  # times the largest other sample: of a usual marker, of any number
_READ_OUTS = ("o_", "grs_")  # channels with noise in every sample
_SET_POINTS = "guidance_"  # channels that stay at the numbers that an operator chooses


def check_markers(
    place: str, channel: str, values: Array, fs: float, *, is_complete: bool = False, cure: str = ""
) -> None:
    """Refuse a channel in which a number seems to mark missing samples; InputError names it.

    Parameters
    ----------
    place, channel : str
        File and channel for the message, and the name of the channel.
    values : ndarray, shape (N,)
        Its samples.
    fs : float
        Sample rate [Hz].
    is_complete : bool
        Whether it is stated that no number does.
    cure : str
        What is expected, with ``{marker}`` for the number; by default NaN.
    """
    extreme = Extreme.find(values)
    if not is_complete and extreme.is_marker(channel):
        expected = cure.format(marker=extreme.spell()) if cure else "NaN for each"
        raise InputError(
            f"{place}: {extreme.value:.7g} at sample {extreme.first_sample} "
            f"(t = {extreme.first_sample / fs:.10g} s), {extreme.count} times in all, seems to mark missing "
            f"samples, expected {expected}"
        )


def replace_markers(values: Array, missing: Sequence[float]) -> Array:
    """Return values of an archive, NaN where one is a marker in double or single precision."""
    for marker in missing:
        values = np.where(_equal(values, marker), np.nan, values)
    return values


def _equal(values: Array, marker: float) -> NDArray[np.bool_]:
    """Return which values are a number, or what single precision makes of it."""
    with np.errstate(over="ignore"):
        single = float(np.float32(marker))
        close = np.isclose(values, marker, rtol=_DOUBLE, atol=0.0)
    return np.asarray(close | ((values == single) & np.isfinite(single)))


@dataclass(frozen=True)
class Extreme:
    """The finite value of largest size in a channel.

    Attributes
    ----------
    value : float
        That value.
    count, first_sample : int
        How often its size comes, and the number of the first sample that has it.
    largest_other : float
        The largest size of all other samples.
    n_samples : int
        Number of samples.
    """

    value: float
    count: int
    first_sample: int
    largest_other: float
    n_samples: int

    @classmethod
    def find(cls, values: Array) -> "Extreme":
        """Find that of a channel."""
        size = np.where(np.isfinite(values), np.abs(values), -1.0)
        extreme = size == size.max(initial=0.0)
        n = int(np.argmax(extreme)) if size.size else 0
        value = float(values[n]) if extreme.any() else 0.0
        rest = float(size[~extreme].max(initial=0.0))
        return cls(value, int(np.count_nonzero(extreme)), n, rest, values.size)

    def is_marker(self, channel: str) -> bool:
        """Say whether the value marks missing samples of a channel, as far as one can see."""
        if channel not in CHANNELS or not 2 <= self.count < self.n_samples:
            return False
        size = abs(self.value)
        usual = size >= _HUGE or (not channel.startswith(_SET_POINTS) and self._is_usual())
        if usual and size > _MARKER_RATIO * self.largest_other:
            return True
        is_rare = self.count < self.n_samples / 2
        return channel.startswith(_READ_OUTS) and is_rare and size > _NUMBER_RATIO * self.largest_other > 0.0

    def _is_usual(self) -> bool:
        size = np.array([abs(self.value)])
        return any(_equal(size, marker).any() for marker in USUAL)

    def spell(self) -> str:
        """Return the value with as few digits as `replace_markers` needs to recognise it."""
        spelt = (f"{self.value:.{digits}g}" for digits in range(7, 17))
        value = np.array([self.value])
        return next((text for text in spelt if _equal(value, float(text)).all()), repr(self.value))
