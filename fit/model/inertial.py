"""Inertial forces: what a turning spacecraft adds to Delta g_x to make it Delta g (eq. gomegafinal).

Delta g = Delta g_x + g_Omega + g_dOmega + delta_g_SC,
g_Omega = -(Omega_phi^2 + Omega_eta^2) d,    g_dOmega = d (-dOmega_phi delta_phi + dOmega_eta delta_eta)
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BASELINE = 0.376  # m, from test mass 1 to test mass 2


def g_Omega(Omega: Array) -> Array:
    """Return the centrifugal term [m s^-2] (eq. centrifugal) of rates [rad/s] of shape (N, 2)."""
    return np.asarray(-BASELINE * np.sum(Omega**2, axis=1))


def euler(dOmega: Array) -> Array:
    """Return g_dOmega per unit of delta_phi and delta_eta [m s^-2], shape (N, 2), of dOmega [rad s^-2]."""
    return dOmega * (-BASELINE, BASELINE)
