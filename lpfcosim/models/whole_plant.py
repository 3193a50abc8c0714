"""The whole spacecraft without FMUs: what the co-simulation of it has to reproduce."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lpfcosim.models import drive, electrodes
from lpfcosim.models.loop import BLOCK, check_inside
from lpfcosim.models.whole_loops import COMMANDS, INPUTS, READ_OUTS, leak_of_f_x_1, limits, loop
from lpfcosim.models.whole_rigid import ANGLES, MOTION, OMEGA, Apparent
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]


# The rows of a track end in commands, quadratic terms of this sample and of the one before.
_f_x_1 = INPUTS.index("f_x_1")
_f_x_2, _N_1, _N_2 = (COMMANDS.index(name) for name in ("f_x_2", "N_phi_1", "N_phi_2"))
_u, _q, _before = slice(-len(COMMANDS) - 30, -30), slice(-30, -15), slice(-15, None)


def simulate(run: Run, driven: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """Simulate a run of the whole spacecraft from its equilibrium.

    Parameters
    ----------
    run : Run
        With a `Spacecraft`.
    driven : mapping of str to ndarray, shape (n_samples,)
        Injections, set points and noise by name, SI; what is missing is zero. By default those of the run.

    Returns
    -------
    dict
        By name, each of shape (n_samples,), SI: `READ_OUTS`, `COMMANDS`, ``f_x_1``, ``guidance_o_1``,
        ``guidance_o_12``; and the truth, `whole_rigid.MOTION` and ``Omega_theta``, ``Omega_eta``,
        ``Omega_phi``.

    Raises
    ------
    DivergenceError
        If o_1 or o_12 leaves +-1e-4 m.
    """
    if driven is None:
        driven = drive.injections(run) | drive.noise(run)
    still = np.zeros(run.n_samples)
    limit = limits(run).get("f_x_1", 0.0)
    f_x_1 = np.clip(driven.get("F_x_1", still) / run.m_tm, -limit, limit) + driven.get("f_x_1_jitter", still)
    inputs = [{**driven, "f_x_1": f_x_1}.get(name, still) for name in INPUTS]
    f_x_2 = driven.get("F_x_2", still) / run.m_tm

    track = _Track(run, electrodes.excess(run, driven))
    channels = {name: np.empty(run.n_samples) for name in (*READ_OUTS, *COMMANDS, *_TRUE)}
    for begin in range(0, run.n_samples, BLOCK):
        block = slice(begin, begin + BLOCK)
        w = np.stack([values[block] for values in inputs], axis=1)
        for name, values in track.advance(w, f_x_2[block]).items():
            channels[name][block] = values
        check_inside(run, channels["o_1"][block], channels["o_12"][block], begin)
    channels["f_x_1"] = f_x_1 + leak_of_f_x_1(run) * channels["N_phi_1"]
    return channels | {name: driven.get(name, still) for name in ("guidance_o_1", "guidance_o_12")}


_TRUE = (*MOTION, *(f"Omega_{k}" for k in ANGLES))


class _Track:
    """Steps the closed loop, in blocks."""

    def __init__(self, run: Run, excess: tuple[electrodes.Excess, electrodes.Excess] | None) -> None:
        self._step = step = loop(run)
        # the commands that follow are asked of the state that follows
        advance = np.hstack([step.A, step.B_u, 1.5 * step.B_q, -0.5 * step.B_q])
        self._matrix = np.vstack([advance, step.C_u @ advance])
        self._rates = np.hstack([step.C_r, step.E_r])
        limit = limits(run)
        self._top = np.array([limit.get(command, np.inf) for command in COMMANDS])
        self._bottom = -self._top
        self._apparent = Apparent(run)
        self._state = step.start
        self._before: Array | None = None
        self._excess, self._done = excess, 0
        # what an excess of the commands f_x_1 and f_x_2 adds to the following row and to the rates
        into = np.stack([step.B[:, _f_x_1], step.B_u[:, _f_x_2]], axis=1)
        self._felt = np.vstack([into, step.C_u @ into])
        self._felt_at_once = np.stack([step.D_r[:, _f_x_1], step.E_r[:, _f_x_2]], axis=1)
        self._leak = leak_of_f_x_1(run)

    def advance(self, w: Array, f_x_2: Array) -> dict[str, Array]:
        """Simulate the next samples, driven by w (`INPUTS`) and by ``f_x_2`` on top of its loop."""
        step, n = self._step, len(self._state)
        external = w @ step.D_u.T + step.u_start
        external[:, COMMANDS.index("f_x_2")] += f_x_2
        push = w @ step.B.T
        ask = push @ step.C_u.T
        ask[:-1] += external[1:]
        push = np.hstack([push, ask])
        rates = w @ step.D_r.T
        rows = np.zeros((len(w) + 1, n + len(COMMANDS) + 30))
        rows[0, :n] = self._state
        rows[0, _u] = step.C_u @ self._state + external[0]
        before = self._before
        with np.errstate(over="ignore", invalid="ignore"):  # check_inside tells, with the time
            for i, (now, following, pushed, rate) in enumerate(
                zip(rows[:-1], rows[1:], push, rates, strict=True)
            ):
                u = now[_u]
                np.minimum(u, self._top, out=u)
                np.maximum(u, self._bottom, out=u)
                if self._excess:
                    more = self._more(i, w[i, _f_x_1], u)
                    pushed += self._felt @ more
                    rate += self._felt_at_once @ more
                now[_q] = self._apparent(now, self._rates @ now[: _q.start] + rate)
                now[_before] = now[_q] if before is None else before
                before = now[_q]
                ahead = following[: _q.start]
                np.dot(self._matrix, now, out=ahead)
                ahead += pushed
        self._done += len(w)
        self._state, self._before = rows[-1, :n].copy(), rows[-2, _q].copy()
        rows = rows[:-1]
        read_outs = rows[:, :n] @ step.C.T + w[:, : len(READ_OUTS)]
        columns = np.hstack([read_outs, rows[:, _u], rows[:, :15], rows[:, OMEGA]])
        return dict(zip((*READ_OUTS, *COMMANDS, *_TRUE), columns.T, strict=True))

    def _more(self, i: int, f_x_1: float, u: Array) -> Array:
        """Return the excess of f_x_1 and f_x_2 at a sample of a block [m s^-2]."""
        assert self._excess is not None
        N_1, N_2 = float(u[_N_1]), float(u[_N_2])
        f_1, f_2 = f_x_1 + self._leak * N_1, float(u[_f_x_2])
        n = self._done + i
        return np.array([self._excess[0](n, f_1, N_1), self._excess[1](n, f_2, N_2)])
