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


def lead_time(outcome: IRLSResult, lambda_name: str, C_name: str) -> str | None:
    """Return by how many seconds a command acts before it is given, in print; None if it does not.

    Its gain and the product of gain and delay have these names; both must be determined.
    """
    positions = outcome.determined
    if not {lambda_name, C_name} <= positions.keys():
        return None
    gain, C = (float(outcome.solution.theta[positions[name]]) for name in (lambda_name, C_name))
    sigma = float(outcome.solution.sigma[positions[C_name]])
    early = -C / gain if gain > 0 else 0.0
    return concise_value(early, sigma / gain) if early > max(EARLY, CERTAIN * sigma / gain) else None


def find_acausal(agreed: Agreement) -> list[Finding]:
    """Doubt a joint fit in which commands act before they are given: some time is wrong in every run."""
    outcome = agreed.outcome
    commands, early_commands = agreed.experiments[0].sysid.spacecraft.commands, dict[str, str]()
    for name in outcome.determined:
        gain, of_command = name.replace("C_", "lambda_", 1), name.removeprefix("C_")
        if name.startswith("C_") and (lead := lead_time(outcome, gain, name)):
            command = next(channel for channel in commands if channel.endswith(of_command))
            early_commands[name] = (
                f"{command} acts {lead} s before it is commanded: it is late in the files of every run, or "
                "the read-outs are early"
            )
    if not early_commands:
        return []
    message = f"{'; '.join(early_commands.values())}; C is not that of the actuators"
    return [Finding("acausal", message, parameters=tuple(early_commands))]
