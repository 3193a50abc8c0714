"""Commands at the limit of their authority: there the loop is not the linear one that is fitted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import InputError
from lpfcosim.plant import planning, stability
from lpfcosim.spacecraft import Run
from lpfcosim.worlds import world_of

AT_LIMIT = 1 - 1e-12  # of the authority, rounding apart


def count(run: Run, block: Mapping[str, NDArray[np.float64]]) -> int:
    """Count the samples of a block in which a command is at its limit."""
    limits = world_of(run).limits(run)
    reached = [np.abs(block[name]) >= limit * AT_LIMIT for name, limit in limits.items() if name in block]
    return int(np.any(reached, axis=0).sum())


def expected(run: Run) -> tuple[str, float] | None:
    """Return a command that injections take beyond its limit, without any noise, and in units of the limit.

    None if there is none, or if the loop is not stable, of which `stability.check` tells.
    """
    try:
        stability.check(run)
    except InputError:
        return None
    asked = planning.response(run)
    for name, limit in world_of(run).limits(run).items():
        if name in asked:
            start = run.f_x_2_start if name == "f_x_2" else 0.0
            largest = float(np.abs(asked[name] + start).max())
            if largest > limit:
                return name, largest / limit
    return None
