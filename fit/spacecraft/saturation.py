"""Saturation: where a command is at the limit of the authority that its file states."""

import numpy as np
from numpy.typing import NDArray

from fit.telemetry import CHANNELS

Array = NDArray[np.float64]

AT_LIMIT = 0.999  # of the authority, read-outs and rounding of archives apart


def at_limit(f_x: Array, limit: float) -> NDArray[np.bool_]:
    """Return where a command along x is at the limit of its authority, shape (N,)."""
    if limit <= 0:  # without authority there is only what leaks
        return np.zeros(f_x.size, dtype=bool)
    return (f_x >= AT_LIMIT * limit) | (f_x <= -AT_LIMIT * limit)


def limit_text(name: str, limit: float) -> str:
    """Return the limit of a command as an equation."""
    per_mass = "/m_tm" if CHANNELS[name].unit == "m s-2" else ""
    return f"F_max_{name[-1]}{per_mass} = {limit:.3g} {CHANNELS[name].unit}"
