"""The campaigns of a Monte Carlo: the same plan with other noise and, if wanted, other truths."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lpfcosim.campaign.campaign import Campaign
from lpfcosim.models import SCATTERED, STIFFNESS
from lpfcosim.signals import generator
from lpfcosim.spacecraft import H

GAINS, COEFFICIENTS = 0.05, 0.3  # how far truths are redrawn from those of the campaign, relative, uniformly


def numbered(plan: Campaign, number: int, *, redraw: bool) -> Campaign:
    """Return campaign `number` of a Monte Carlo, the same whatever else is simulated."""
    random = generator(plan.seed, "campaign", str(number))
    seed = int(random.integers(2**63))
    truth = redrawn(plan.truth, random) if redraw else plan.truth
    return replace(plan, seed=seed, truth=truth)


def redrawn(truth: Mapping[str, float], random: np.random.Generator) -> dict[str, float]:
    """Return truths up to 5 % (gains) and 30 % (stiffness, delays, delta_ifo) away from `truth`."""
    names = [*SCATTERED, *STIFFNESS, *(name for name in truth if name.startswith("delta_ifo_"))]
    drawn = {name: float(truth[name] * random.uniform(1 - reach(name), 1 + reach(name))) for name in names}
    for j in (1, 2):  # a delay is never shorter than half the hold
        drawn[f"C_{j}"] = max(drawn[f"C_{j}"], 0.51 * H * drawn[f"lambda_{j}"])
    return {**truth, **drawn}


def reach(name: str) -> float:
    """Return how far a truth is redrawn from that of the campaign, relative, uniformly."""
    return GAINS if name.startswith("lambda_") else COEFFICIENTS
