"""Estimates that no sensor or actuator has: a channel of another unit, sign, test mass or time."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.model import Spacecraft
from fit.units import concise_value
from fit.whitening import Experiment

Array = NDArray[np.float64]

CERTAIN = 5.0  # sigma
LEVEL_RATIO = 300.0  # between the test masses; prefixes of units differ by 1000


def implausible_estimates(outcome: IRLSResult, spacecraft: Spacecraft) -> Iterator[Finding]:
    """Yield a warning for each determined parameter beyond the range that it may have."""
    positions = outcome.determined
    theta, sigma = outcome.solution.theta, outcome.solution.sigma
    for name, plausible in spacecraft.ranges.items():
        i = positions.get(name)
        if i is None:
            continue
        margin = CERTAIN * sigma[i]
        if not plausible.low - margin < theta[i] < plausible.high + margin:
            yield Finding(
                "invalid_data",
                f"{plausible.channel}: {name} is estimated as {concise_value(theta[i], sigma[i])}, expected "
                f"{plausible.low:g} to {plausible.high:g}: {plausible.indication}",
                parameters=(name,),
            )


def level_faults(experiment: Experiment) -> Iterator[Finding]:
    """Yield the channels whose noise differs by orders of magnitude from that of the other test mass."""
    for run in filter(None, (experiment.sysid, experiment.noise)):
        for pair in run.spacecraft.alike:
            levels = {name: _noise_level(run.channels.series[name]) for name in pair}
            if not all(levels.values()):
                continue
            (name, lowest), (noisiest, highest) = sorted(levels.items(), key=lambda item: item[1])
            if highest > LEVEL_RATIO * lowest:
                words = (
                    f"{noisiest}: its noise is {highest / lowest:.2g} times that of {name}, expected less "
                    f"than {LEVEL_RATIO:g}: one of the two is in another unit"
                )
                telemetry = run.telemetry
                yield Finding("invalid_data", f"{telemetry.path}: {words}", telemetry.run, noisiest)


def _noise_level(x: Array) -> float:
    """Return the median size of the second difference of a channel, in which slow motion does not count."""
    return float(np.median(np.abs(np.diff(x, 2))))
