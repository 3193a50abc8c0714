"""Inertial forces: what a turning spacecraft adds to Delta g_x to make it Delta g (Eq. (22)).

Delta g = Delta g_x + g_Omega + g_dOmega + delta_g_SC,
g_Omega = -(Omega_phi^2 + Omega_eta^2) d,    g_dOmega = d (-dOmega_phi delta_phi + dOmega_eta delta_eta),

with d = x_2 - x_1: positive where +x points from test mass 1 to test mass 2, negative in the paper's frame,
which is the first turned by 180 degrees about z. There y and eta change sign along with x, so that
delta_phi = delta_y / d is the same in both frames and delta_eta = delta_z / d is of the other sign.
"""

import numpy as np
from numpy.typing import NDArray

from fit.telemetry import TOWARDS_1, XAxis

Array = NDArray[np.float64]

BASELINE = 0.376  # m, between the test masses


def separation(x_axis: XAxis) -> float:
    """Return d = x_2 - x_1 [m] in a frame."""
    return -BASELINE if x_axis == TOWARDS_1 else BASELINE


def g_Omega(Omega: Array, d: float) -> Array:
    """Return the centrifugal term [m s^-2] (Eq. (20)) of rates [rad/s] of shape (N, 2)."""
    return np.asarray(-d * np.sum(Omega**2, axis=1))


def euler(dOmega: Array, d: float) -> Array:
    """Return g_dOmega per unit of delta_phi and delta_eta [m s^-2], shape (N, 2), of dOmega [rad s^-2]."""
    return dOmega * (-d, d)


def along(d: float) -> dict[str, tuple[str, float]]:
    """Return by coefficient of Eq. (3) the angle that makes the same force above 10 mHz, and its factor.

    There phi'' = -dOmega_phi, so that g_dOmega = d delta_phi phi'' - d delta_eta eta''.
    """
    return {"b_1": ("delta_phi", d), "b_2": ("delta_eta", -d)}
