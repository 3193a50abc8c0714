"""Estimates that no sensor or actuator has: a channel of another unit, sign, test mass or time."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.agreement import Agreement
from fit.findings import Finding
from fit.fitting import IRLSResult
from fit.units import concise_value
from fit.whitening import Experiment

Array = NDArray[np.float64]

CERTAIN = 5.0  # sigma
EARLY = 0.05  # s, half a control step: by so much a time may be a matter of convention
MAX_DELAY = 3.0  # times the delays of the flight; no actuator comes near


def find(outcome: IRLSResult, experiments: Sequence[Experiment], *_: object) -> Iterator[Finding]:
    """Yield each determined parameter beyond the range that it may have."""
    positions, spacecraft = outcome.determined, experiments[0].sysid.spacecraft
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


def find_delays(agreed: Agreement) -> Iterator[Finding]:
    """Yield each delay of a joint fit that no actuator has: some time is wrong in every run."""
    outcome, spacecraft = agreed.outcome, agreed.experiments[0].sysid.spacecraft
    theta, sigma, positions = outcome.solution.theta, outcome.solution.sigma, outcome.determined
    longest = MAX_DELAY * max(spacecraft.delays)
    for name, i in positions.items():
        gain = name.replace("C_", "lambda_", 1)
        if not name.startswith("C_") or gain not in positions:
            continue
        scale = float(theta[positions[gain]])
        delay, error = (float(x[i]) / scale for x in (theta, sigma))
        margin = max(EARLY, CERTAIN * error)
        if scale > 0 and not -margin < delay < longest + margin:
            command = next(c for c in spacecraft.commands if c.endswith(name.removeprefix("C_")))
            message = (
                f"{command} acts {concise_value(delay, error)} s after it is commanded, expected 0 to "
                f"{longest:g} s: its time or that of the read-outs is wrong in every run, or read-outs are "
                f"averages; {name} is not that of the actuators"
            )
            yield Finding("implausible_delay", message, channel=command, parameters=(name,))
