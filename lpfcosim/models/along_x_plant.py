"""The loop along x without FMUs, exactly discretised: what the co-simulation has to reproduce.

Continuous plant, seen from the spacecraft (signs in `lpfcosim.spacecraft.parameters`)::

    F_j    = m_tm (g_j - omega2_j x_j + a_j)       force on test mass j, which pushes back on the spacecraft
    x_j''  = F_j / m_tm - a_SC                     m_sc a_SC = F_thrust + F_noise_x_sc - F_1 - F_2
    a_j(t) = lambda_j f_x_j(t - (tau_j - h/2))     F_thrust' = (F_x_sc(t - thruster_delay) - F_thrust) / lag

Commands are held for a sample and their transport delays are not whole samples, so a force switches inside a
step. The plant is linear, so each step is exact: the old value acts up to the switch, the new one after it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lpfcosim.models import drive, electrodes
from lpfcosim.models.loop import (
    BLOCK,
    Loop,
    System,
    block_diagonal,
    check_inside,
    held,
    linear,
    on_circle,
    sampled,
)
from lpfcosim.models.world import Gain
from lpfcosim.spacecraft import Run

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


def plant(run: Run) -> Plant:
    """Discretise the three bodies, the thrusters and the delays exactly."""
    r, h = run.m_tm / run.m_sc, run.h
    k_1, k_2 = -run.omega2_1, -run.omega2_2
    # rows: x_1', v_1', x_2', v_2', F_thrust'; columns: the same states, then PLANT_INPUTS
    force_1 = np.array([k_1, 0, 0, 0, 0, 0, run.truth.lambda_1, 0, 1, 0, 0])  # F_j / m_tm
    force_2 = np.array([0, 0, k_2, 0, 0, 0, 0, run.truth.lambda_2, 0, 1, 0])
    thrust = np.array([0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1]) / run.m_sc
    a_sc = thrust - r * (force_1 + force_2)
    continuous = np.zeros((5, 11))
    continuous[0, 1] = continuous[2, 3] = 1
    continuous[1] = force_1 - a_sc
    continuous[3] = force_2 - a_sc
    continuous[4, [4, 5]] = np.array([-1, 1]) / run.thruster_lag

    transports = (run.thruster_delay, max(run.tau_1 - h / 2, 0.0), max(run.tau_2 - h / 2, 0.0))
    values = (run.F_x_sc_start, 0.0, run.f_x_2_start)  # commands issued before the run
    lengths = [int(transport // h) + 1 for transport in transports]
    # the new value acts after the switch
    switches = (length * h - transport for length, transport in zip(lengths, transports, strict=True))
    whole, *late = held(continuous, [h, *switches])
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
    C[1, [0, 2]] = run.delta_ifo - 1, 1
    return Plant(A, B, C, start)


def loop(run: Run) -> Loop:
    """Close the drag-free loop exactly and the suspension loop up to the authority of f_x_2."""
    body = plant(run)
    n = len(body.A)
    decay_1, entry_1, direct_1 = sampled(run.drag_free, run.h)
    decay_2, entry_2, direct_2 = sampled(run.suspension, run.h)

    # read-outs o = C state + D_o w and errors e = C state + D_e w of both loops; commands F_x_sc and f_x_2
    C = np.hstack([body.C, np.zeros((2, 6))])
    D_o = np.hstack([np.eye(2), np.zeros((2, 6))])
    D_e = np.hstack([np.eye(2), -np.eye(2), np.zeros((2, 4))])
    F_c = run.m_sc * direct_1 * C[0]
    F_c[n : n + 3] = run.m_sc
    F_d = run.m_sc * direct_1 * D_e[0]
    c_2 = -direct_2 * C[1]
    c_2[n + 3 :] = -1

    A = block_diagonal(body.A, np.diag(decay_1), np.diag(decay_2))
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
        inputs=LOOP_INPUTS,
        commands=("f_x_2",),
        read_outs=("o_1", "o_12", "F_x_sc"),
        A=A,
        B=B,
        B_u=np.concatenate([body.B[:, 2], np.zeros(6)])[:, np.newaxis],
        C_u=c_2[np.newaxis],
        D_u=(-direct_2 * D_e[1])[np.newaxis],
        u_start=np.array([run.f_x_2_start]),
        C=np.vstack([C, F_c]),
        D=np.vstack([D_o, F_d]),
        start=np.concatenate([body.start, np.zeros(6)]),
    )


def system(run: Run) -> System:
    """Close both loops."""
    return linear(loop(run), run, leak=np.zeros(1))


def open_loop(run: Run) -> Gain:
    """Give the loop gain of the sampled system, both loops cut at their errors.

    Returns
    -------
    callable
        From frequency [Hz], shape (n,), to L, shape (n, 2, 2), in (o_1, o_12) = -L (o_1 - guidance_o_1,
        o_12 - guidance_o_12), with noise left out and no command at its limit; exact.
    """
    body = plant(run)

    def gain(frequency: ArrayLike) -> NDArray[np.complex128]:
        z = on_circle(frequency, run.h)
        from_commands = body.C @ np.linalg.solve(z * np.eye(len(body.A)) - body.A, body.B[:, [0, 2]])
        gains = []
        for law, scale in ((run.drag_free, run.m_sc), (run.suspension, -1.0)):
            decay, entry, direct = sampled(law, run.h)
            gains.append(scale * ((entry / (z[:, 0] - decay)).sum(axis=1) + direct))
        return np.asarray(-from_commands * np.stack(gains, axis=1)[:, np.newaxis, :])

    return gain


def limits(run: Run) -> dict[str, float]:
    """Largest command that authority allows, by telemetry channel, in the units of the channels."""
    # On test mass 1 a leak adds to what is clipped; without authority there is no command to be clipped.
    F_max = {"f_x_2": run.authority.F_max_2, "f_x_1": run.authority.F_max_1}
    return {name: force / run.m_tm for name, force in F_max.items() if force > 0 or name == "f_x_2"}


def simulate(run: Run) -> dict[str, Array]:
    """Simulate a run from its equilibrium.

    Returns
    -------
    dict
        ``o_1``, ``o_12``, ``guidance_o_1``, ``guidance_o_12`` [m], ``f_x_1``, ``f_x_2`` [m s^-2] and
        ``F_x_sc`` [N], each of shape (n_samples,).

    Raises
    ------
    DivergenceError
        If o_1 or o_12 leaves +-1e-4 m.
    """
    step = loop(run)
    (b_2,), (c_2,), (d_2,), (start_2,) = step.B_u.T, step.C_u, step.D_u, step.u_start
    injected, drawn = drive.injections(run), drive.noise(run)
    limit = limits(run)
    limit_1, limit_2 = limit.get("f_x_1", 0.0), limit["f_x_2"]
    f_x_1 = np.clip(injected["F_x_1"] / run.m_tm, -limit_1, limit_1) + drawn["f_x_1_jitter"]
    excess_1, excess_2 = electrodes.excess(run, drawn) or (None, None)
    received_1 = excess_1.received(f_x_1) if excess_1 else f_x_1
    w = np.stack([{**injected, **drawn, "f_x_1": received_1}[name] for name in LOOP_INPUTS], axis=1)
    asked = start_2 + injected["F_x_2"] / run.m_tm + w @ d_2

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
        with np.errstate(over="ignore", invalid="ignore"):  # check_inside tells, with the time
            _advance(track, advance, push, limit_2, excess_2, begin)
            readout[block] = track[:-1, :-1] @ step.C.T + w[block] @ step.D.T
        latest = track[-1]
        f_x_2[block] = track[:-1, -1]
        check_inside(run, readout[block, 0], readout[block, 1], begin)
    return {
        "o_1": readout[:, 0].copy(),
        "o_12": readout[:, 1].copy(),
        "f_x_1": f_x_1,
        "f_x_2": f_x_2,
        "guidance_o_1": injected["guidance_o_1"],
        "guidance_o_12": injected["guidance_o_12"],
        "F_x_sc": readout[:, 2].copy(),
    }


def _advance(
    track: Array, advance: Array, push: Array, limit: float, excess: electrodes.Excess | None, begin: int
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
