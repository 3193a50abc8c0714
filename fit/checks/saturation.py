"""Where a commanded force is at the limit of its authority, the force that acted is unknown: it is masked.

The equation holds sample by sample: what is masked takes nothing else with it but the reach of low-pass and
stencils.
"""

from collections.abc import Iterator

import numpy as np

from fit.campaign import Campaign
from fit.findings import Finding
from fit.requirements import MOST_SATURATED
from fit.spacecraft import saturation
from fit.whitening import Experiment, Run


def find(campaign: Campaign) -> list[Finding]:
    """Return where runs are saturated."""
    return campaign.find_each(_of_experiment, campaign.experiments.values())


def _of_experiment(e: Experiment) -> Iterator[Finding]:
    for run in e.runs:
        yield from saturated(run)


def saturated(run: Run) -> Iterator[Finding]:
    """Yield the stretches in which a command of a run is at its limit, or that they are too much of it."""
    telemetry = run.telemetry
    limits = run.spacecraft.limits(telemetry)
    flags = {name: saturation.at_limit(telemetry.channels[name], limit) for name, limit in limits.items()}
    if not any(limited.any() for limited in flags.values()):
        return
    spans = run.spans(np.any([*flags.values()], axis=0))
    channels = " and ".join(
        f"{name} in {int(np.count_nonzero(limited))} samples ({saturation.limit_text(name, limits[name])})"
        for name, limited in flags.items()
        if limited.any()
    )
    message = f"{telemetry.run}: a commanded force is at the limit of its authority: {channels}"
    weight = run.mask(spans).weight / run.weight
    if weight < 1 - MOST_SATURATED:
        cost = f"masking would remove {100 * (1 - weight):.0f} % of the run"
        yield Finding("saturated_too_long", f"{message}; {cost}, so nothing is masked", telemetry.run)
    else:
        message = f"{message}; these are masked, {100 * weight:.3g} % is left"
        yield Finding("saturated", message, telemetry.run, spans=spans)
