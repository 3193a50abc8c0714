"""Noise of the electrostatic actuation along x.

Electrode k of a test mass pulls with F_k (`spacecraft.actuation`); a relative noise eps_k of its voltage adds
2 eps_k F_k. Of the force along x, the sum over k of s_k times that, four electrodes leave three sums:

    dF_x = e_x (F_max + N_max/arm) + e_F F + e_N N/arm
    e_x = sum s_k eps_k / 2        e_F = sum eps_k / 2        e_N = sum s_k t_k eps_k / 2

Each has the noise of one electrode, and they are independent; what the electrodes have in common adds 2 eps_c
to e_F alone, which is the signal ``gain_j``. The model of the actuation says what they do; these signals are
wired only in runs that have them.
"""

import math

from lpfcosim.signals import Source, flicker
from lpfcosim.spacecraft import ARM, Run


def sources(run: Run) -> tuple[Source, ...]:
    """Return the streams that a run along x asks for."""
    electrode = run.actuation.electrode
    gain = math.hypot(electrode, 2 * run.actuation.electrode_common)
    levels = {f"{kind}_{j}": level for j in (1, 2) for kind, level in (("e_x", electrode), ("gain", gain))}
    return tuple(flicker(name, level) for name, level in levels.items() if level)


def torque_sources(run: Run) -> tuple[Source, ...]:
    """Return the streams in addition where torques about z are commanded."""
    electrode = run.actuation.electrode
    return tuple(flicker(f"e_N_{j}", electrode) for j in (1, 2)) if electrode else ()


def parameters(run: Run) -> dict[str, float]:
    """Return the parameters of the actuation that a run with noisy electrodes sets in addition, SI."""
    if not run.actuation.electrode:
        return {}
    return {"arm": ARM, "N_max_1": run.authority.N_max_1, "N_max_2": run.authority.N_max_2}
