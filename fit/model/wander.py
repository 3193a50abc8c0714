"""How the gain of a force may change within a run: with time, or with the force itself.

To first order, with u from -1/2 at the start of a run to 1/2 at its end,

    lambda_j f_j  ->  (lambda_j + slope_j u + bend_j |f_j| / max |f_j|) f_j

so that ``slope_j`` is by how much the gain grows over the run, and ``bend_j`` by how much it is larger at the
largest force than at none.
"""

import numpy as np
from numpy.typing import NDArray

from fit.model.dynamics import COLUMNS, FORCES, Channels, Columns, forces
from fit.signal import derivatives

NAMES = ("slope_1", "slope_2", "bend_1", "bend_2")
_INNER = slice(derivatives.HALF, -derivatives.HALF)  # of what stencils are applied to
_SIGNS = {1: 1.0, 2: -1.0}  # with which the forces enter Delta g, see `dynamics`


def commanded(run: Channels, tau: tuple[float, float]) -> Columns:
    """Return the columns of the commands, and no others, delayed by `tau` [s]."""
    valid = ~derivatives.reached(~run.valid)
    return Columns(tau, tuple([*COLUMNS][FORCES]), run.fs, run.time[_INNER], forces(run, tau), valid)


def columns(found: Columns) -> NDArray[np.float64]:
    """Return what multiplies `NAMES` in Delta g, shape (N, 4) [m s^-2], from columns of the commands."""
    u = np.linspace(-0.5, 0.5, len(found.values))
    slopes, bends = [], []
    for j, sign in _SIGNS.items():
        force = sign * found.values[:, found.names.index(f"f_{j}")]
        largest = float(np.max(np.abs(force), where=found.valid, initial=0.0))
        slopes.append(u * force)
        bends.append(force * np.abs(force) / (largest or 1.0))
    return np.stack([*slopes, *bends], axis=1)
