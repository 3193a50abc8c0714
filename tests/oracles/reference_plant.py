"""The loop along x, written by hand and exactly discretised; it shares no code with the simulator.

Continuous plant, seen from the spacecraft (signs in `lpfcosim.constants`)::

    F_j    = m_tm (g_j - omega2_j x_j + a_j)       force on test mass j, which pushes back on the spacecraft
    x_j''  = F_j / m_tm - a_SC                     m_sc a_SC = F_thrust + F_noise_x_sc - F_1 - F_2
    a_j(t) = lambda_j f_x_j(t - (tau_j - h/2))     F_thrust' = (F_x_sc(t - thruster_delay) - F_thrust) / lag

Commands are held for a sample and their transport delays are not whole samples, so a force switches inside a
step. The plant is linear, so each step is exact: the old value acts up to the switch, the new one after it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag, expm

from lpfcosim.spacecraft import Run

PLANT_INPUTS = ("F_x_sc", "f_x_1", "f_x_2", "g_1", "g_2", "F_noise_x_sc")
LOOP_INPUTS = ("n_1", "n_12", "guidance_o_1", "guidance_o_12", "f_x_1", "g_1", "g_2", "F_noise_x_sc")

Array = NDArray[np.float64]
ARM = 11e-3  # m, of an electrode
BLOCK = 6000  # samples between two looks at the read-out range


Law = Mapping[str, float]  # f_u, f_z, f_i, f_p, f_r [Hz]


def law(run: Run, model: str) -> Law:
    """Return a control law along x, of one that may be part of the whole spacecraft."""
    return run.control.get(model) or run.control[f"Whole{model}"]


def stiffness(run: Run, j: int) -> float:
    """Return omega2_j, Eq. (8) [s^-2]."""
    t, a = run.truth, run.authority
    F_max, N_max = {1: (a.F_max_1, a.N_max_1), 2: (a.F_max_2, a.N_max_2)}[j]
    return t[f"omega2_{j}_0"] + t[f"alpha_x_{j}"] * F_max + t[f"alpha_phi_{j}"] * N_max


def command_before(run: Run) -> float:
    """Return the command on test mass 2 before the run [m s^-2]."""
    return -run.dc / run.truth["lambda_2"]


def gain(law: Law) -> float:
    """Return the k [s^-1] of K(s) that makes |K(i 2 pi fu)| = (2 pi fu)^2 at the unity gain fu."""
    s = 2j * math.pi * law["f_u"]
    wz, wi, wp, wr = (2 * math.pi * f for f in (law[name] for name in ("f_z", "f_i", "f_p", "f_r")))
    shape = (s + wz) * (s + wi) / (s * (1 + s / wp) * (1 + s / wr))
    return abs(s) ** 2 / abs(shape)


def partial_fractions(law: Law) -> tuple[Array, Array]:
    """Return p_i [rad/s] and r_i [s^-3] of the parallel form K(s) = sum_i r_i / (s + p_i)."""
    wz, wi = 2 * math.pi * law["f_z"], 2 * math.pi * law["f_i"]
    wp, wr = 2 * math.pi * law["f_p"], 2 * math.pi * law["f_r"]
    scale = gain(law) * wp * wr
    residues = (
        scale * wz * wi / (wp * wr),
        scale * (wz - wp) * (wi - wp) / (-wp * (wr - wp)),
        scale * (wz - wr) * (wi - wr) / (-wr * (wp - wr)),
    )
    return np.array([0.0, wp, wr]), np.array(residues)


def discretize_zoh(rates: Array, times: ArrayLike) -> Array:
    """Solve x' = A x + B u exactly, with u held.

    Parameters
    ----------
    rates : ndarray, shape (n, n + m)
        A and B, side by side [s^-1].
    times : array_like, shape (k,)
        For how long [s].

    Returns
    -------
    ndarray, shape (k, n, n + m)
        What x and u at the beginning make of x at the end.
    """
    n, m = len(rates), rates.shape[1] - len(rates)
    augmented = np.vstack([rates, np.zeros((m, n + m))])
    return np.array([expm(augmented * t)[:n] for t in times])


def tustin(law: Law, h: float) -> tuple[Array, Array, float]:
    """Discretise K(s) = sum r_i / (s + p_i) with the bilinear rule.

    Returns
    -------
    decay, entry : ndarray, shape (3,)
        ``state+ = decay * state + entry * e``, one state per pole.
    direct : float
        ``K e = sum(state) + direct * e``.
    """
    p, r = partial_fractions(law)
    decay = (2 - p * h) / (2 + p * h)
    direct = r * h / (2 + p * h)
    return decay, direct * (1 + decay), float(direct.sum())


@dataclass(frozen=True)
class Plant:
    """One exact step, ``state+ = A state + B u`` with u = `PLANT_INPUTS` in SI and (x_1, o_12) = ``C state``.

    The state is x_1, v_1, x_2, v_2 [m, m/s], F_thrust [N], then for F_x_sc, f_x_1 and f_x_2 in turn the
    commands already issued and still needed, newest first; ``start`` is its value at the equilibrium.
    """

    A: Array
    B: Array
    C: Array
    start: Array


def plant(run: Run) -> Plant:
    """Discretise the three bodies, the thrusters and the delays exactly."""
    m_sc = run.truth["m_sc"]
    r, h = run.m_tm / m_sc, run.h
    k_1, k_2 = -stiffness(run, 1), -stiffness(run, 2)
    # rows: x_1', v_1', x_2', v_2', F_thrust'; columns: the same states, then PLANT_INPUTS
    force_1 = np.array([k_1, 0, 0, 0, 0, 0, run.truth["lambda_1"], 0, 1, 0, 0])  # F_j / m_tm
    force_2 = np.array([0, 0, k_2, 0, 0, 0, 0, run.truth["lambda_2"], 0, 1, 0])
    thrust = np.array([0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1]) / m_sc
    a_sc = thrust - r * (force_1 + force_2)
    continuous = np.zeros((5, 11))
    continuous[0, 1] = continuous[2, 3] = 1
    continuous[1] = force_1 - a_sc
    continuous[3] = force_2 - a_sc
    continuous[4, [4, 5]] = np.array([-1, 1]) / run.truth["T_sc"]

    taus = [run.truth[f"C_{j}"] / run.truth[f"lambda_{j}"] for j in (1, 2)]
    transports = (run.truth["tau_sc"], *(max(tau - h / 2, 0.0) for tau in taus))
    values = (0.0, 0.0, command_before(run))  # commands issued before the run
    lengths = [int(transport // h) + 1 for transport in transports]
    # the new value acts after the switch
    switches = (length * h - transport for length, transport in zip(lengths, transports, strict=True))
    whole, *late = discretize_zoh(continuous, [h, *switches])
    n = 5 + sum(lengths)
    A, B, start = np.zeros((n, n)), np.zeros((n, 6)), np.zeros(n)
    A[:5, :5] = whole[:, :5]
    B[:5, 3:] = whole[:, 8:]
    first = 5
    for i, (length, value) in enumerate(zip(lengths, values, strict=True)):
        after = late[i][:, 5 + i]
        before = whole[:, 5 + i] - after
        A[:5, first + length - 1] += before
        if length > 1:
            A[:5, first + length - 2] += after
        else:
            B[:5, i] += after
        B[first, i] = 1
        A[range(first + 1, first + length), range(first, first + length - 1)] = 1
        start[first : first + length] = value
        first += length
    C = np.zeros((2, n))
    C[0, 0] = 1
    C[1, [0, 2]] = run.truth[f"delta_ifo_{run.alignment_epoch}"] - 1, 1
    return Plant(A, B, C, start)


@dataclass(frozen=True)
class PlantAndController:
    """One step of plant and controllers around the command f_x_2, which authority may clip.

    ``state+ = A state + B w + b_2 f_x_2`` with w = `LOOP_INPUTS`; the controller asks for
    ``f_x_2 = c_2 state + d_2 w + start_2``; ``C state + D w`` are o_1, o_12 and F_x_sc; SI.
    """

    A: Array
    B: Array
    b_2: Array
    c_2: Array
    d_2: Array
    start_2: float
    C: Array
    D: Array
    start: Array


def loop(run: Run) -> PlantAndController:
    """Close the drag-free loop exactly and the suspension loop up to the authority of f_x_2."""
    body, m_sc = plant(run), run.truth["m_sc"]
    n = len(body.A)
    decay_1, entry_1, direct_1 = tustin(law(run, "DragFreeControl"), run.h)
    decay_2, entry_2, direct_2 = tustin(law(run, "SuspensionControl"), run.h)

    # read-outs o = C state + D_o w and errors e = C state + D_e w of both loops; commands F_x_sc and f_x_2
    C = np.hstack([body.C, np.zeros((2, 6))])
    D_o = np.hstack([np.eye(2), np.zeros((2, 6))])
    D_e = np.hstack([np.eye(2), -np.eye(2), np.zeros((2, 4))])
    F_c = m_sc * direct_1 * C[0]
    F_c[n : n + 3] = m_sc
    F_d = m_sc * direct_1 * D_e[0]
    c_2 = -direct_2 * C[1]
    c_2[n + 3 :] = -1

    A = block_diag(body.A, np.diag(decay_1), np.diag(decay_2))
    A[n : n + 3] += np.outer(entry_1, C[0])
    A[n + 3 :] += np.outer(entry_2, C[1])
    B = np.zeros((n + 6, len(LOOP_INPUTS)))
    B[n : n + 3] = np.outer(entry_1, D_e[0])
    B[n + 3 :] = np.outer(entry_2, D_e[1])
    B[:n, 4] = body.B[:, 1]
    B[:n, 5:] = body.B[:, 3:]
    thrust = np.concatenate([body.B[:, 0], np.zeros(6)])
    A += np.outer(thrust, F_c)
    B += np.outer(thrust, F_d)
    return PlantAndController(
        A=A,
        B=B,
        b_2=np.concatenate([body.B[:, 2], np.zeros(6)]),
        c_2=c_2,
        d_2=-direct_2 * D_e[1],
        start_2=command_before(run),
        C=np.vstack([C, F_c]),
        D=np.vstack([D_o, F_d]),
        start=np.concatenate([body.start, np.zeros(6)]),
    )


def limits(run: Run) -> dict[str, float]:
    """Largest command that authority allows, by telemetry channel, in the units of the channels."""
    # On test mass 1 a leak adds to what is clipped; without authority there is no command to be clipped.
    F_max = {"f_x_2": run.authority.F_max_2, "f_x_1": run.authority.F_max_1}
    return {name: force / run.m_tm for name, force in F_max.items() if force > 0 or name == "f_x_2"}


def preload(run: Run, j: int) -> float:
    """Return what a relative noise e_x makes of the balanced pulls of the electrodes [m s^-2]."""
    a = run.authority
    F_max, N_max = {1: (a.F_max_1, a.N_max_1), 2: (a.F_max_2, a.N_max_2)}[j]
    return (F_max + N_max / ARM) / run.m_tm


@dataclass(frozen=True)
class ActuationError:
    """What test mass j receives beyond lambda_j times its command, as a command that would do the same.

    Attributes
    ----------
    gain : ndarray, shape (n,)
        Relative change of the gain.
    push : ndarray, shape (n,)
        Whatever the command [m s^-2].
    twist : ndarray, shape (n,)
        Per torque about z [kg^-1 m^-1].
    """

    gain: Array
    push: Array
    twist: Array

    def __call__(self, i: int, f: float, N: float = 0.0) -> float:
        """Return it at sample i, for a command f [m s^-2] and a torque N about z [N m]."""
        return float(f * self.gain[i] + self.push[i] + self.twist[i] * N)

    def received(self, f: Array) -> Array:
        """Return commands, shape (n,), with their excess."""
        return f * (1 + self.gain) + self.push


def actuation_errors(run: Run, drawn: Mapping[str, Array]) -> tuple[ActuationError, ActuationError] | None:
    """Return what both test masses receive in excess, None if it is nothing.

    Parameters
    ----------
    run : Run
        Whose actuation it is.
    drawn : mapping of str to ndarray, shape (n,)
        Stimuli of the actuation.
    """
    gains = run.truth["lambda_1"], run.truth["lambda_2"]
    if not any(f"{name}_{j}" in drawn for name in ("e_x", "gain") for j in (1, 2)):
        return None
    still = np.zeros(run.n_samples)

    def of(j: int) -> ActuationError:
        e_x, e_N, gain = (drawn.get(f"{name}_{j}", still) for name in ("e_x", "e_N", "gain"))
        per_lambda = 1 / gains[j - 1]
        return ActuationError(
            gain,
            e_x * preload(run, j) * per_lambda,
            e_N * per_lambda / (ARM * run.m_tm),
        )

    return of(1), of(2)


def simulate(run: Run, stimuli: Mapping[str, Array]) -> dict[str, Array]:
    """Simulate a run from its equilibrium, driven by injections and noise by name.

    Returns
    -------
    dict
        ``o_1``, ``o_12``, ``guidance_o_1``, ``guidance_o_12`` [m], ``f_x_1``, ``f_x_2`` [m s^-2] and
        ``F_x_sc`` [N], each of shape (n_samples,).

    Raises
    ------
    ValueError
        If o_1 or o_12 leaves +-1e-4 m.
    """
    step = loop(run)
    b_2, c_2, d_2, start_2 = step.b_2, step.c_2, step.d_2, step.start_2
    limit = limits(run)
    limit_1, limit_2 = limit.get("f_x_1", 0.0), limit["f_x_2"]
    f_x_1 = np.clip(stimuli["F_x_1"] / run.m_tm, -limit_1, limit_1) + stimuli["f_x_1_jitter"]
    excess_1, excess_2 = actuation_errors(run, stimuli) or (None, None)
    received_1 = excess_1.received(f_x_1) if excess_1 else f_x_1
    w = np.stack([{**stimuli, "f_x_1": received_1}[name] for name in LOOP_INPUTS], axis=1)
    asked = start_2 + stimuli["F_x_2"] / run.m_tm + w @ d_2

    # The rows of `track` are (state, f_x_2): each follows from the one before, then authority clips f_x_2.
    advance = np.column_stack([step.A, b_2])
    advance = np.vstack([advance, c_2 @ advance])
    latest = np.append(step.start, np.clip(c_2 @ step.start + asked[0], -limit_2, limit_2))
    readout, f_x_2 = np.empty((run.n_samples, 3)), np.empty(run.n_samples)
    for begin in range(0, run.n_samples, BLOCK):
        block = slice(begin, min(begin + BLOCK, run.n_samples))
        push = w[block] @ step.B.T
        ask = push @ c_2
        ask[: len(asked) - begin - 1] += asked[begin + 1 : block.stop + 1]
        push = np.column_stack([push, ask])
        track = np.empty((len(push) + 1, len(latest)))
        track[0] = latest
        with np.errstate(over="ignore", invalid="ignore"):  # read-outs that diverge are refused
            _advance(track, advance, push, limit_2, excess_2, begin)
            readout[block] = track[:-1, :-1] @ step.C.T + w[block] @ step.D.T
        latest = track[-1]
        f_x_2[block] = track[:-1, -1]
        if not np.all(np.abs(readout[block, :2]) <= 1e-4):
            raise ValueError(f"{run.name}: the loop diverged")
    return {
        "o_1": readout[:, 0].copy(),
        "o_12": readout[:, 1].copy(),
        "f_x_1": f_x_1,
        "f_x_2": f_x_2,
        "guidance_o_1": stimuli["guidance_o_1"],
        "guidance_o_12": stimuli["guidance_o_12"],
        "F_x_sc": readout[:, 2].copy(),
    }


def _advance(
    track: Array, advance: Array, push: Array, limit: float, excess: ActuationError | None, begin: int
) -> None:
    """Fill the rows of ``track`` after its first, which is of sample ``begin``."""
    felt = advance[:, -1]
    steps = zip(track[:-1], track[1:], push, strict=True)
    for i, (now, following, pushed) in enumerate(steps, begin):
        np.dot(advance, now, out=following)
        following += pushed
        if excess:
            following += excess(i, now[-1]) * felt
        if not -limit <= following[-1] <= limit:
            following[-1] = min(max(following[-1], -limit), limit)
