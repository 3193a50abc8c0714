"""The closed loop without FMUs, exactly discretised: what the co-simulation has to reproduce.

Continuous plant, seen from the spacecraft (signs in `lpfcosim.spacecraft.parameters`)::

    F_j    = m_tm (g_j - omega2_j x_j + a_j)       force on test mass j, which pushes back on the spacecraft
    x_j''  = F_j / m_tm - a_SC                     m_sc a_SC = F_thrust + F_noise_x_sc - F_1 - F_2
    a_j(t) = lambda_j f_x_j(t - (tau_j - h/2))     F_thrust' = (F_x_sc(t - thruster_delay) - F_thrust) / lag

Commands are held for a sample and their transport delays are not whole samples, so a force switches inside a
step. The plant is linear, so each step is exact: the old value acts up to the switch, the new one after it.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.errors import RunError
from lpfcosim.plant import signals
from lpfcosim.spacecraft import READ_OUT_RANGE, Controller, Run

BLOCK = 6000  # samples between two looks at the read-out range

PLANT_INPUTS = ("F_x_sc", "f_x_1", "f_x_2", "g_1", "g_2", "F_noise_x_sc")
LOOP_INPUTS = ("n_1", "n_12", "guidance_o_1", "guidance_o_12", "f_x_1", "g_1", "g_2", "F_noise_x_sc")

Array = NDArray[np.float64]


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


@dataclass(frozen=True)
class Loop:
    """One step of plant and controllers around f_x_2, which authority may clip.

    ``state+ = A state + B w + b_2 f_x_2`` with w = `LOOP_INPUTS`; the suspension asks for
    ``c_2 state + d_2 w``; the rows of ``C state + D w`` are o_1, o_12, F_x_sc.
    """

    A: Array
    B: Array
    b_2: Array
    c_2: Array
    d_2: Array
    C: Array
    D: Array
    start: Array

    @property
    def closed(self) -> Array:
        """State matrix of the linear closed loop, no command at its limit."""
        return self.A + np.outer(self.b_2, self.c_2)


def plant(run: Run) -> Plant:
    """Discretise the three bodies, the thrusters and the delays exactly."""
    r, h = run.m_tm / run.m_sc, run.h
    k_1, k_2 = -run.omega2_1, -run.omega2_2
    # rows: x_1', v_1', x_2', v_2', F_thrust'; columns: the same states, then PLANT_INPUTS
    force_1 = np.array([k_1, 0, 0, 0, 0, 0, run.truth.lambda_1, 0, 1, 0, 0])  # F_j / m_tm
    force_2 = np.array([0, 0, k_2, 0, 0, 0, 0, run.truth.lambda_2, 0, 1, 0])
    thrust = np.array([0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1]) / run.m_sc
    a_sc = thrust - r * (force_1 + force_2)
    continuous = np.zeros((11, 11))
    continuous[0, 1] = continuous[2, 3] = 1
    continuous[1] = force_1 - a_sc
    continuous[3] = force_2 - a_sc
    continuous[4, [4, 5]] = np.array([-1, 1]) / run.thruster_lag

    whole = scipy.linalg.expm(continuous * h)[:5]
    transports = (run.thruster_delay, max(run.tau_1 - h / 2, 0.0), max(run.tau_2 - h / 2, 0.0))
    values = (run.F_x_sc_start, 0.0, run.f_x_2_start)  # commands issued before the run
    lengths = [int(transport // h) + 1 for transport in transports]
    n = 5 + sum(lengths)
    A, B, start = np.zeros((n, n)), np.zeros((n, 6)), np.zeros(n)
    A[:5, :5] = whole[:, :5]
    B[:5, 3:] = whole[:, 8:]
    first = 5
    for i, (transport, length, value) in enumerate(zip(transports, lengths, values, strict=True)):
        # the new value acts after the switch
        after = scipy.linalg.expm(continuous * (length * h - transport))[:5, 5 + i]
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
    C[1, [0, 2]] = run.delta_ifo - 1, 1
    return Plant(A, B, C, start)


def controller(settings: Controller, h: float) -> tuple[Array, Array, float]:
    """Discretise K(s) = sum r_i / (s + p_i) with the bilinear rule.

    Returns
    -------
    decay, entry : ndarray, shape (3,)
        ``state+ = decay * state + entry * e``, one state per pole.
    direct : float
        ``K e = sum(state) + direct * e``.
    """
    p, r = np.array(settings.rates), np.array(settings.residues)
    decay = (2 - p * h) / (2 + p * h)
    direct = r * h / (2 + p * h)
    return decay, direct * (1 + decay), float(direct.sum())


def loop(run: Run) -> Loop:
    """Close the drag-free loop exactly and the suspension loop up to the authority of f_x_2."""
    body = plant(run)
    n = len(body.A)
    decay_1, entry_1, direct_1 = controller(run.drag_free, run.h)
    decay_2, entry_2, direct_2 = controller(run.suspension, run.h)

    # read-outs o = C state + D_o w and errors e = C state + D_e w of both loops; commands F_x_sc and f_x_2
    C = np.hstack([body.C, np.zeros((2, 6))])
    D_o = np.hstack([np.eye(2), np.zeros((2, 6))])
    D_e = np.hstack([np.eye(2), -np.eye(2), np.zeros((2, 4))])
    F_c = run.m_sc * direct_1 * C[0]
    F_c[n : n + 3] = run.m_sc
    F_d = run.m_sc * direct_1 * D_e[0]
    c_2 = -direct_2 * C[1]
    c_2[n + 3 :] = -1

    A = scipy.linalg.block_diag(body.A, np.diag(decay_1), np.diag(decay_2))
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
    return Loop(
        A=A,
        B=B,
        b_2=np.concatenate([body.B[:, 2], np.zeros(6)]),
        c_2=c_2,
        d_2=-direct_2 * D_e[1],
        C=np.vstack([C, F_c]),
        D=np.vstack([D_o, F_d]),
        start=np.concatenate([body.start, np.zeros(6)]),
    )


def open_loop(run: Run, frequency: Array) -> NDArray[np.complex128]:
    """Loop gain of the sampled system, both loops cut at their errors.

    Parameters
    ----------
    run : Run
        Where the loop comes from; no command is at its limit.
    frequency : ndarray, shape (n,)
        Hz.

    Returns
    -------
    ndarray, shape (n, 2, 2)
        L in (o_1, o_12) = -L (o_1 - guidance_o_1, o_12 - guidance_o_12), with noise left out; exact.
    """
    body = plant(run)
    z = np.exp(2j * np.pi * run.h * np.asarray(frequency))[:, np.newaxis, np.newaxis]
    from_commands = body.C @ np.linalg.solve(z * np.eye(len(body.A)) - body.A, body.B[:, [0, 2]])
    gains = []
    for settings, scale in ((run.drag_free, run.m_sc), (run.suspension, -1.0)):
        decay, entry, direct = controller(settings, run.h)
        gains.append(scale * ((entry / (z[:, 0] - decay)).sum(axis=1) + direct))
    return np.asarray(-from_commands * np.stack(gains, axis=1)[:, np.newaxis, :])


def simulate(run: Run) -> dict[str, Array]:
    """Simulate a run from its equilibrium.

    Returns
    -------
    dict
        ``o_1``, ``o_12``, ``guidance_o_1``, ``guidance_o_12`` [m], ``f_x_1``, ``f_x_2`` [m s^-2] and
        ``F_x_sc`` [N], each of shape (n_samples,).

    Raises
    ------
    RunError
        If o_1 or o_12 leaves +-1e-4 m.
    """
    step = loop(run)
    injected, drawn = signals.injections(run), signals.noise(run)
    limit_1, limit_2 = run.authority.F_max_1 / run.m_tm, run.authority.F_max_2 / run.m_tm
    f_x_1 = np.clip(injected["F_x_1"] / run.m_tm, -limit_1, limit_1) + drawn["f_x_1_jitter"]
    w = np.stack([{**injected, **drawn, "f_x_1": f_x_1}[name] for name in LOOP_INPUTS], axis=1)
    asked = run.f_x_2_start + injected["F_x_2"] / run.m_tm + w @ step.d_2

    # The rows of `track` are (state, f_x_2): each follows from the one before, then authority clips f_x_2.
    advance = np.column_stack([step.A, step.b_2])
    advance = np.vstack([advance, step.c_2 @ advance])
    latest = np.append(step.start, np.clip(step.c_2 @ step.start + asked[0], -limit_2, limit_2))
    readout, f_x_2 = np.empty((run.n_samples, 3)), np.empty(run.n_samples)
    for begin in range(0, run.n_samples, BLOCK):
        block = slice(begin, min(begin + BLOCK, run.n_samples))
        push = w[block] @ step.B.T
        ask = push @ step.c_2
        ask[: len(asked) - begin - 1] += asked[begin + 1 : block.stop + 1]
        push = np.column_stack([push, ask])
        track = np.empty((len(push) + 1, len(latest)))
        track[0] = latest
        with np.errstate(over="ignore", invalid="ignore"):  # _check_inside tells, with the time
            for now, following, pushed in zip(track[:-1], track[1:], push, strict=True):
                np.dot(advance, now, out=following)
                following += pushed
                if not -limit_2 <= following[-1] <= limit_2:
                    following[-1] = min(max(following[-1], -limit_2), limit_2)
            readout[block] = track[:-1, :-1] @ step.C.T + w[block] @ step.D.T
        latest = track[-1]
        f_x_2[block] = track[:-1, -1]
        _check_inside(run, readout[block], begin)
    return {
        "o_1": readout[:, 0].copy(),
        "o_12": readout[:, 1].copy(),
        "f_x_1": f_x_1,
        "f_x_2": f_x_2,
        "guidance_o_1": injected["guidance_o_1"],
        "guidance_o_12": injected["guidance_o_12"],
        "F_x_sc": readout[:, 2].copy(),
    }


def _check_inside(run: Run, readout: Array, begin: int) -> None:
    lost = ~(np.abs(readout[:, :2]) <= READ_OUT_RANGE)  # true for NaN too
    if lost.any():
        i = int(lost.any(axis=1).argmax())
        channel = "o_1" if lost[i, 0] else "o_12"
        time = (begin + i) / run.fs
        raise RunError(
            f"{run.name}: the loop diverged, {channel} left +-{READ_OUT_RANGE:g} m at t = {time:g} s"
        )
