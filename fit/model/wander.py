"""How the gain of a force may change within a run: with time, or with the force itself.

To first order, with u from -1/2 at the start of a run to 1/2 at its end,

    lambda_j f_j  ->  (lambda_j + slope_j u + bend_j |f_j| / max |f_j|) f_j

so that ``slope_j`` is by how much the gain grows over the run, and ``bend_j`` by how much it is larger at the
largest force than at none.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.model.dynamics import Channels, Columns, blank, force

NAMES = ("slope_1", "slope_2", "bend_1", "bend_2")
_SIGNS = {1: 1.0, 2: -1.0}  # with which the forces enter Delta g, see `dynamics`


def commanded(run: Channels, tau: tuple[float, float]) -> Columns:
    """Return the columns of the commands themselves, and no others, delayed by `tau` [s]."""
    found = blank(run, tau)
    values = np.empty((found.valid.size, 2), order="F")
    for k, j in enumerate((1, 0)):
        values[:, k] = force(run, j, tau)[:, 0]
    return replace(found, names=tuple(f"f_{j}" for j in (2, 1)), values=values)


def columns(found: Columns) -> NDArray[np.float64]:
    """Return what multiplies `NAMES` in Delta g, shape (N, 4) [m s^-2], from columns of the commands."""
    return np.concatenate(list(parts(found)), axis=1)


def parts(found: Columns) -> Iterator[NDArray[np.float64]]:
    """Yield the same one by one, shape (N, 1)."""
    forces = [(found.values[:, found.names.index(f"f_{j}")], sign) for j, sign in _SIGNS.items()]
    for f, sign in forces:
        yield (np.linspace(-0.5 * sign, 0.5 * sign, len(f)) * f)[:, None]
    for f, sign in forces:
        size = np.abs(f)
        size *= sign / (float(np.max(size, where=found.valid, initial=0.0)) or 1.0)
        size *= f
        yield size[:, None]
