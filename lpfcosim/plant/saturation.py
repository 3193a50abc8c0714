"""Commands at the limit of their authority: there the loop is not the linear one that is fitted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lpfcosim.spacecraft import Run
from lpfcosim.worlds import world_of

AT_LIMIT = 1 - 1e-12  # of the authority, rounding apart


def count(run: Run, block: Mapping[str, NDArray[np.float64]]) -> int:
    """Count the samples of a block in which a command is at its limit."""
    limits = world_of(run).limits(run)
    reached = [np.abs(block[name]) >= limit * AT_LIMIT for name, limit in limits.items() if name in block]
    return int(np.any(reached, axis=0).sum())
