"""Estimates that no sensor or actuator has: a channel of another unit, sign, test mass or time."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.fitting import IRLSResult
from fit.quality import fit_quality
from fit.telemetry import Telemetry
from fit.units import concise_value
from fit.warnings import FitWarning

Array = NDArray[np.float64]

LEVEL_RATIO = 300.0  # between the test masses; prefixes of units differ by 1000


class _Range(NamedTuple):
    """Plausible values of a parameter, the channel that it belongs to, and what another value indicates."""

    low: float
    high: float
    channel: str
    indication: str


_UNIT_OR_SIGN = "its unit or its sign is wrong"
#: By parameter without the number of the test mass. Commands of the two test masses that are exchanged act
#: along x as much as along y, since their axes are 60 degrees apart.
RANGES = {
    "lambda_x": _Range(0.3, 3.0, "F_x", _UNIT_OR_SIGN),
    "lambda_y": _Range(0.3, 3.0, "F_y", _UNIT_OR_SIGN),
    "grs_gain_y": _Range(0.3, 3.0, "grs_y", _UNIT_OR_SIGN),
    "x_per_y": _Range(-0.3, 0.3, "F_y", "it is of another test mass or axis"),
}


def implausible_estimates(outcome: IRLSResult) -> Iterator[FitWarning]:
    """Yield a warning for each determined gain beyond `RANGES`, and for each delay below zero."""
    positions = outcome.determined
    theta, sigma = outcome.solution.theta, outcome.solution.sigma
    for name, i in positions.items():
        quantity, test_mass = name[:-2], name[-1]
        if plausible := RANGES.get(quantity):
            channel = f"{plausible.channel}_{test_mass}"
            margin = fit_quality.CERTAIN * sigma[i]
            if not plausible.low - margin < theta[i] < plausible.high + margin:
                yield FitWarning(
                    "invalid_data",
                    (name,),
                    f"{channel}: {name} is estimated as {concise_value(theta[i], sigma[i])}, expected "
                    f"{plausible.low:g} to {plausible.high:g}: {plausible.indication}",
                )
        gain = name.replace("C_", "lambda_", 1)
        has_delay = name.startswith("C_") and gain in positions and theta[positions[gain]] > 0
        if has_delay and (lead := fit_quality.lead_time(outcome, gain, name)):
            message = (
                f"{name.replace('C_', 'F_', 1)} acts {lead} s before it is commanded: it is late in the "
                f"files, or read-outs are early; {name} is not that of the actuator"
            )
            yield FitWarning("acausal", (name,), message)


def check_levels(run: Telemetry) -> None:
    """Refuse a run in which the same channel of the two test masses differs by orders of magnitude.

    Raises
    ------
    InputError
        If the noise of one is `LEVEL_RATIO` times that of the other.
    """
    for quantity in ("o", "grs_y", "F_y"):
        names = [f"{quantity}_{j}" for j in (1, 2) if f"{quantity}_{j}" in run.channels]
        levels = {name: _noise_level(run.channels[name]) for name in names}
        if len(levels) < 2 or not all(levels.values()):
            continue
        (name, lowest), (noisiest, highest) = sorted(levels.items(), key=lambda item: item[1])
        if highest > LEVEL_RATIO * lowest:
            raise InputError(
                f"{run.path}: {noisiest}: its noise is {highest / lowest:.2g} times that of {name}, expected "
                f"less than {LEVEL_RATIO:g}: one of the two is in another unit"
            )


def _noise_level(x: Array) -> float:
    """Return the median size of the second difference of a channel, in which slow motion does not count."""
    difference = np.abs(np.diff(x, 2))
    return float(np.median(difference[np.isfinite(difference)])) if np.isfinite(difference).any() else 0.0
