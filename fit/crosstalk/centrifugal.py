"""The coefficient of g_Omega: whether the centrifugal term is there as the stated frame has it.

The sign of g_Omega = -d Omega^2 is that of d = x_2 - x_1, whatever that of Omega. So its coefficient must
come out as 1. Where the spacecraft turns as in flight, half a day gives it to 0.1, three days to 0.05. At -1
the telemetry is in the other frame, or all read-outs and forces along x are of the other sign. At neither,
the rotation is not that measured by torques and star tracker.
"""

from dataclasses import replace

from fit.false_alarms import sigma_limit
from fit.findings import Finding
from fit.parameters import Parameter, cross_talk_parameter
from fit.results import Estimate
from fit.telemetry import TOWARDS_1, TOWARDS_2, XAxis
from fit.units import concise_value

NOTABLE = 0.25  # of the coefficient; torques whose gain is not known, or without angles, make 0.15
FRAME, STRENGTH = "frame_contradicted", "centrifugal_strength"
_ANGLES = ("delta_phi", "delta_eta")
#: By how much it exceeds 1; the width is no knowledge, it only keeps the equations solvable.
EXCESS: Parameter = replace(cross_talk_parameter("b_1"), name="g_Omega", unit="1", prior_sigma=10.0)


def frame_warnings(estimate: Estimate, x_axis: XAxis, n_periods: int = 1) -> list[Finding]:
    """Warn of a coefficient of g_Omega that the data say is not 1.

    Parameters
    ----------
    estimate : Estimate
        The coefficient.
    x_axis : str
        The frame that the telemetry states.
    n_periods : int
        Number of periods that are tested.
    """
    observation = f"the coefficient of g_Omega is {concise_value(estimate.value, estimate.sigma)}"
    if abs(estimate.value - 1) <= max(sigma_limit(n_periods) * estimate.sigma, NOTABLE):
        return []
    if estimate.value < -0.5:
        opposite = TOWARDS_2 if x_axis == TOWARDS_1 else TOWARDS_1
        message = (
            f"the telemetry contradicts its frame, +x {x_axis}: {observation}, expected 1; with x_axis = "
            f"{opposite!r} it would be {-estimate.value:.3g}"
        )
        return [Finding(FRAME, message, parameters=_ANGLES)]
    message = (
        f"{observation}, expected 1: torques and star tracker do not measure the rotation that acts along x"
    )
    return [Finding(STRENGTH, message, parameters=_ANGLES)]


def contradicts(warnings: tuple[Finding, ...]) -> bool:
    """Return whether the data contradict the stated frame."""
    return any(warning.code == FRAME for warning in warnings)
