"""The campaigns of a Monte Carlo: the same plan with other noise and, if wanted, other truths."""

from dataclasses import replace

import numpy as np

from lpfcosim.campaign.campaign import Campaign
from lpfcosim.signals import generator
from lpfcosim.spacecraft import H, Truth

GAINS, COEFFICIENTS = 0.05, 0.3  # how far truths are redrawn from those of the campaign, relative, uniformly


def numbered(plan: Campaign, number: int, *, redraw: bool) -> Campaign:
    """Return campaign `number` of a Monte Carlo, the same whatever else is simulated."""
    random = generator(plan.seed, "campaign", str(number))
    seed = int(random.integers(2**63))
    truth = redrawn(plan.truth, random) if redraw else plan.truth
    return replace(plan, seed=seed, truth=truth)


def redrawn(truth: Truth, random: np.random.Generator) -> Truth:
    """Return truths up to 5 % (gains) and 30 % (stiffness, delays, delta_ifo) away from `truth`."""

    def scattered(value: float, reach: float) -> float:
        return float(value * random.uniform(1 - reach, 1 + reach))

    gains = {name: scattered(getattr(truth, name), GAINS) for name in ("lambda_1", "lambda_2")}
    delays = {f"C_{j}": scattered(getattr(truth, f"C_{j}"), COEFFICIENTS) for j in (1, 2)}
    return replace(
        truth,
        **gains,
        # a delay is never shorter than half the hold
        **{name: max(C, 0.51 * H * gains[f"lambda_{name[-1]}"]) for name, C in delays.items()},
        **{
            name: scattered(getattr(truth, name), COEFFICIENTS)
            for name in ("omega2_1_0", "omega2_2_0", "alpha_x_1", "alpha_x_2", "alpha_phi_1", "alpha_phi_2")
        },
        delta_ifo={k: scattered(value, COEFFICIENTS) for k, value in truth.delta_ifo.items()},
    )
