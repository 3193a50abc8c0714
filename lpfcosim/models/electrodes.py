"""Electrodes along x: what a test mass feels beyond its gain times its command.

Electrode k of a test mass pulls with F_k (`spacecraft.actuation`); a relative noise eps_k of its voltage adds
2 eps_k F_k. Of the force along x, the sum over k of s_k times that, four electrodes leave three sums:

    dF_x = e_x (F_max + N_max/arm) + e_F F + e_N N/arm
    e_x = sum s_k eps_k / 2        e_F = sum eps_k / 2        e_N = sum s_k t_k eps_k / 2

Each has the noise of one electrode, and they are independent; what the electrodes have in common adds 2 eps_c
to e_F alone. A change e_F of the gain, be it by noise, drift or random walk, is the signal ``gain_j``. With
lambda growing with the force by ``lambda_bend_j`` at F_ref, a test mass of commanded f = F/m_tm receives

    lambda_j f (1 + lambda_bend_j |F|/F_ref) (1 + gain_j)
        + (e_x_j (F_max_j + N_max_j/arm) + e_N_j N/arm) / m_tm

These signals are wired only in runs that have them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals import GainDrift, Source, flicker
from lpfcosim.spacecraft import ARM, F_REF, Run

Array = NDArray[np.float64]

UNITS = {
    **{f"{name}_{j}": "1" for name in ("e_x", "gain", "lambda_bend") for j in (1, 2)},
    "arm": "m",
    "F_ref": "N",
}
UNITS_ABOUT_Z = {"e_N_1": "1", "e_N_2": "1"}
#: Input or parameter of the actuation to the names under /truth that hang on it.
TRUTHS = {
    **{f"gain_{j}": (f"lambda_drift_{j}", f"lambda_walk_{j}") for j in (1, 2)},
    **{f"lambda_bend_{j}": (f"lambda_bend_{j}",) for j in (1, 2)},
}


def sources(run: Run) -> tuple[Source, ...]:
    """Return the streams that a run along x asks for."""
    found: list[Source] = []
    electrode, truth = run.actuation.electrode, run.truth
    gain = math.hypot(electrode, 2 * run.actuation.electrode_common)
    drift_and_walk = {
        1: (truth.lambda_drift_1, truth.lambda_walk_1),
        2: (truth.lambda_drift_2, truth.lambda_walk_2),
    }
    for j, (drift, walk) in drift_and_walk.items():
        found += (*flicker(f"e_x_{j}", electrode), *flicker(f"gain_{j}", gain))
        if drift or walk:
            found.append(GainDrift(f"gain_{j}_wander", f"gain_{j}", walk, drift=drift))
    return tuple(found)


def about_z(run: Run) -> tuple[Source, ...]:
    """Return the streams in addition where torques about z are commanded."""
    return tuple(source for j in (1, 2) for source in flicker(f"e_N_{j}", run.actuation.electrode))


def inputs(run: Run, more: Iterable[Source] = ()) -> dict[str, str]:
    """Return the inputs of the actuation that a run wires beside the usual ones, with their sources."""
    return {name: name for source in (*sources(run), *more) for name, _ in source.shares}


def parameters(run: Run) -> dict[str, float]:
    """Return the parameters of the actuation that a run sets beside the usual ones, SI."""
    truth = run.truth
    found: dict[str, float] = {}
    if run.actuation.electrode:
        found |= {"arm": ARM, "N_max_1": run.authority.N_max_1, "N_max_2": run.authority.N_max_2}
    if truth.lambda_bend_1 or truth.lambda_bend_2:
        bends = {"lambda_bend_1": truth.lambda_bend_1, "lambda_bend_2": truth.lambda_bend_2}
        found |= {**bends, "F_ref": F_REF}
    return found


def balance(run: Run, j: int) -> float:
    """Return what a relative noise e_x makes of the balanced pulls of the electrodes [m s^-2]."""
    a = run.authority
    F_max, N_max = {1: (a.F_max_1, a.N_max_1), 2: (a.F_max_2, a.N_max_2)}[j]
    return (F_max + N_max / ARM) / run.m_tm


@dataclass(frozen=True)
class Excess:
    """What test mass j receives beyond lambda_j times its command, as a command that would do the same.

    Attributes
    ----------
    bend : float
        Relative growth of the gain with the command [m^-1 s^2].
    gain : ndarray, shape (n,)
        Relative change of the gain.
    push : ndarray, shape (n,)
        Whatever the command [m s^-2].
    twist : ndarray, shape (n,)
        Per torque about z [kg^-1 m^-1].
    """

    bend: float
    gain: Array
    push: Array
    twist: Array

    def __call__(self, i: int, f: float, N: float = 0.0) -> float:
        """Return it at sample i, for a command f [m s^-2] and a torque N about z [N m]."""
        bent, gain = self.bend * abs(f), self.gain[i]
        return float(f * (bent + gain + bent * gain) + self.push[i] + self.twist[i] * N)

    def received(self, f: Array) -> Array:
        """Return commands, shape (n,), with their excess."""
        return f * (1 + self.bend * np.abs(f)) * (1 + self.gain) + self.push


def excess(run: Run, drawn: Mapping[str, Array]) -> tuple[Excess, Excess] | None:
    """Return what both test masses receive in excess, None if it is nothing.

    Parameters
    ----------
    run : Run
        Whose actuation it is.
    drawn : mapping of str to ndarray, shape (n,)
        The signals of `sources` and `about_z`.
    """
    bends = run.truth.lambda_bend_1, run.truth.lambda_bend_2
    gains = run.truth.lambda_1, run.truth.lambda_2
    if not any(bends) and not any(f"{name}_{j}" in drawn for name in ("e_x", "gain") for j in (1, 2)):
        return None
    still = np.zeros(run.n_samples)

    def of(j: int) -> Excess:
        e_x, e_N, gain = (drawn.get(f"{name}_{j}", still) for name in ("e_x", "e_N", "gain"))
        per_lambda = 1 / gains[j - 1]
        return Excess(
            bends[j - 1] * run.m_tm / F_REF,
            gain,
            e_x * balance(run, j) * per_lambda,
            e_N * per_lambda / (ARM * run.m_tm),
        )

    return of(1), of(2)


def felt(run: Run, rms: tuple[float, float]) -> dict[str, tuple[str, float]]:
    """Return for each signal of `sources` where it acts as a force, linearised, and with which factor.

    Parameters
    ----------
    run : Run
        Whose actuation it is.
    rms : tuple of float
        Of the commands f_x_1 and f_x_2 over the run [m s^-2]. A product of noise and command counts as noise
        times this, which is right for a command that is slow beside the noise.
    """
    lambdas = run.truth.lambda_1, run.truth.lambda_2
    found = {f"e_x_{j}": (f"g_{j}", balance(run, j)) for j in (1, 2)}
    return found | {f"gain_{j}": (f"g_{j}", lambdas[j - 1] * rms[j - 1]) for j in (1, 2)}
