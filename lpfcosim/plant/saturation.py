"""Commands at the limit of their authority: there the loop is not the linear one that is fitted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lpfcosim.spacecraft import Run

AT_LIMIT = 1 - 1e-12  # of the authority, rounding apart


def limits(run: Run) -> dict[str, float]:
    """Largest command that authority allows, by telemetry channel, in the units of the channels."""
    authority, sc = run.authority, run.spacecraft
    # On test mass 1 a leak adds to what is clipped; without authority there is no command to be clipped.
    found = {"f_x_2": authority.F_max_2 / run.m_tm}
    if authority.F_max_1 > 0:
        found["f_x_1"] = authority.F_max_1 / run.m_tm
    if sc is not None:
        for j, N_max in ((1, authority.N_max_1), (2, authority.N_max_2)):
            found |= {f"F_y_{j}": sc.F_max_yz, f"F_z_{j}": sc.F_max_yz}
            found |= {f"N_theta_{j}": sc.N_max_theta, f"N_eta_{j}": sc.N_max_eta, f"N_phi_{j}": N_max}
    return found


def count(run: Run, block: Mapping[str, NDArray[np.float64]]) -> int:
    """Count the samples of a block in which a command is at its limit."""
    reached = [
        np.abs(block[name]) >= limit * AT_LIMIT for name, limit in limits(run).items() if name in block
    ]
    return int(np.any(reached, axis=0).sum())
