"""What the geometry says beforehand of the stiffness: per unit of authority, and of the background.

The paper gives what eqs alphax and alphaphi come to, but not the capacitances in them. Those here are a
choice: parallel plates 4 mm apart, electrodes 11 mm off the axis, consistent with the two numbers it gives.
"""

import math
from dataclasses import dataclass

from fit.results import Estimate, Fit

LAMBDA_V = (1.066, 0.002)  # gain of the applied voltages, and sigma (at eq. alphax)
M_TM = 1.928  # kg
DC_DX = 2.9e-10  # F m-1, of an X electrode to test mass and guard ring: choice
D2C_DX2 = 1.58e-7  # F m-2: choice
DC_DPHI = 3.3e-12  # F rad-1: choice
C_TOT = 34.2e-12  # F, test mass to all that surrounds it: choice

#: What the paper predicts from its own capacitances, the same for both test masses [kg-1 m-1, kg-1 m-2].
PAPER = {"alpha_x": -320.0, "alpha_phi": -26.5e3}

#: Background stiffness of test masses 1 and 2 [s-2] by its causes (section Results).
BUDGET = {
    "gravity gradient": (-3.5e-7, -3.6e-7),
    "100 kHz sensing bias": (-6.4e-8, -6.4e-8),
    "largest test-mass charge": (-3e-9, -3e-9),
}


def background() -> tuple[float, float]:
    """Return the sum of the budget for test masses 1 and 2 [s-2]."""
    first, second = (math.fsum(values) for values in zip(*BUDGET.values(), strict=True))
    return first, second


def alpha_x(lambda_V: float) -> float:
    """Return the stiffness per force authority [kg-1 m-1] at a gain of the voltage (eq. alphax)."""
    return -(lambda_V**2) / M_TM * D2C_DX2 / DC_DX


def alpha_phi(lambda_V: float) -> float:
    """Return the stiffness per torque authority [kg-1 m-2] at a gain of the voltage (eq. alphaphi)."""
    return -(lambda_V**2) / M_TM * (D2C_DX2 - 4 * DC_DX**2 / C_TOT) / DC_DPHI


@dataclass(frozen=True)
class Prediction:
    """One stiffness coefficient as predicted and as fitted.

    Attributes
    ----------
    name : str
        ``alpha_x_j`` or ``alpha_phi_j``.
    value, sigma : float
        Predicted from the capacitances; sigma is that of lambda_V alone.
    paper : float
        What the paper predicts.
    fitted : Estimate
        Of the joint fit.
    lambda_V : Estimate or None
        The gain of the voltages at which the prediction is the fitted value; None if its sign is wrong.
    """

    name: str
    value: float
    sigma: float
    paper: float
    fitted: Estimate
    lambda_V: Estimate | None

    @property
    def excess(self) -> float:
        """Fitted over predicted, less 1."""
        return self.fitted.value / self.value - 1


def predictions(joint: Fit) -> list[Prediction]:
    """Compare with the prediction each stiffness coefficient that the joint fit determines."""
    gain, gain_sigma = LAMBDA_V
    found = []
    for kind, model in (("alpha_x", alpha_x), ("alpha_phi", alpha_phi)):
        for name in (f"{kind}_1", f"{kind}_2"):
            estimate = joint.parameters.get(name)
            if estimate is None:
                continue
            found.append(
                Prediction(
                    name=name,
                    value=model(gain),
                    sigma=2 * gain_sigma / gain * abs(model(gain)),
                    paper=PAPER[kind],
                    fitted=estimate,
                    lambda_V=_gain_that_gives(estimate, model(1.0)),
                )
            )
    return found


def _gain_that_gives(estimate: Estimate, at_one: float) -> Estimate | None:
    ratio = estimate.value / at_one
    if ratio <= 0:
        return None
    gain = math.sqrt(ratio)
    return Estimate(gain, gain * estimate.sigma / (2 * abs(estimate.value)), "1")
