"""Noise and drift of the electrostatic actuation along x.

Electrode k of a test mass pulls with F_k (`spacecraft.actuation`); a relative noise eps_k of its voltage adds
2 eps_k F_k. Of the force along x, the sum over k of s_k times that, four electrodes leave three sums:

    dF_x = e_x (F_max + N_max/arm) + e_F F + e_N N/arm
    e_x = sum s_k eps_k / 2        e_F = sum eps_k / 2        e_N = sum s_k t_k eps_k / 2

Each has the noise of one electrode, and they are independent; what the electrodes have in common adds 2 eps_c
to e_F alone. A change e_F of the gain, be it by noise, drift or random walk, is the signal ``gain_j``. The
model of the actuation says what they do; these signals are wired only in runs that have them.
"""

import math

from lpfcosim.signals import GainDrift, Source, flicker
from lpfcosim.spacecraft import ARM, F_REF, Run


def sources(run: Run) -> tuple[Source, ...]:
    """Return the streams that a run along x asks for."""
    streams: list[Source] = []
    electrode, truth = run.actuation.electrode, run.truth
    gain = math.hypot(electrode, 2 * run.actuation.electrode_common)
    drift_and_walk = {
        1: (truth.lambda_drift_1, truth.lambda_walk_1),
        2: (truth.lambda_drift_2, truth.lambda_walk_2),
    }
    for j, (drift, walk) in drift_and_walk.items():
        streams += (*flicker(f"e_x_{j}", electrode), *flicker(f"gain_{j}", gain))
        if drift or walk:
            streams.append(GainDrift(f"gain_{j}_wander", f"gain_{j}", walk, drift=drift))
    return tuple(streams)


def torque_sources(run: Run) -> tuple[Source, ...]:
    """Return the streams in addition where torques about z are commanded."""
    return tuple(source for j in (1, 2) for source in flicker(f"e_N_{j}", run.actuation.electrode))


def parameters(run: Run) -> dict[str, float]:
    """Return the parameters of the actuation that a run sets in addition to the usual ones, SI."""
    truth = run.truth
    values: dict[str, float] = {}
    if run.actuation.electrode:
        values |= {"arm": ARM, "N_max_1": run.authority.N_max_1, "N_max_2": run.authority.N_max_2}
    if truth.lambda_bend_1 or truth.lambda_bend_2:
        bends = {"lambda_bend_1": truth.lambda_bend_1, "lambda_bend_2": truth.lambda_bend_2}
        values |= {**bends, "F_ref": F_REF}
    return values
