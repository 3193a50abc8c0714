"""What a run is expected to record, without simulating it: its response to the injections, and its noise.

Both are those of the linear closed loop, with no command at its limit. Of what is quadratic in the motion of
the whole spacecraft there is what is linear about its steady turn: a rate that adds to it pulls along x.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.plant import loops, reference, rigid, signals
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE = 1.0  # Hz, of the response; nothing of it lies above half of that
_INJECTED = ("guidance_o_1", "guidance_o_12", "f_x_1", "F_x_2")
BLOCK = 3600  # s, stretch of injections held in memory


@dataclass(frozen=True)
class System:
    """The closed loop, ``state+ = A state + B w`` and ``C state + D w``, about its equilibrium.

    Attributes
    ----------
    A, B, C, D : ndarray
        Of one sample.
    inputs : tuple of str
        The names of w: those of the loop, then ``F_x_2``, a force commanded on top of it [N].
    channels : tuple of str
        Telemetry that can be had.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    channels: tuple[str, ...]


def system(run: Run) -> System:
    """Close the loop of a run, along x or of the whole spacecraft."""
    return _whole(run) if run.spacecraft else _along_x(run)


def _along_x(run: Run) -> System:
    step, inputs = reference.loop(run), (*reference.LOOP_INPUTS, "F_x_2")
    f_x_1 = np.array([float(name == "f_x_1") for name in inputs])
    D_u = np.append(step.d_2, 1 / run.m_tm)
    return System(
        A=step.closed,
        B=_with_none(step.B) + np.outer(step.b_2, D_u),
        C=np.vstack([step.C[:2], step.c_2, np.zeros_like(step.c_2)]),
        D=np.vstack([_with_none(step.D[:2]), D_u, f_x_1]),
        inputs=inputs,
        channels=("o_1", "o_12", "f_x_2", "f_x_1"),
    )


def _whole(run: Run) -> System:
    step, sc, inputs = loops.loop(run), rigid.equipment(run), (*loops.INPUTS, "F_x_2")
    f_x_1 = np.array([float(name == "f_x_1") for name in inputs])
    leak = np.array([sc.leak_phi_1 / run.m_tm * (name == "N_phi_1") for name in loops.COMMANDS])
    D_u = _with_none(step.D_u)
    D_u[loops.COMMANDS.index("f_x_2"), -1] = 1 / run.m_tm
    by_motion, by_rates = turning(run)
    q = by_rates @ (step.C_r + step.E_r @ step.C_u)
    q[:, : by_motion.shape[1]] += by_motion
    D_q = by_rates @ (_with_none(step.D_r) + step.E_r @ D_u)
    return System(
        A=step.closed + step.B_q @ q,
        B=_with_none(step.B) + step.B_u @ D_u + step.B_q @ D_q,
        C=np.vstack([step.C_o, step.C_u, leak @ step.C_u]),
        D=np.vstack([np.eye(len(loops.READ_OUTS), len(inputs)), D_u, f_x_1 + leak @ D_u]),
        inputs=inputs,
        channels=(*loops.READ_OUTS, *loops.COMMANDS, "f_x_1"),
    )


def _with_none(matrix: Array) -> Array:
    """Add a column for the last input, which does nothing here."""
    return np.pad(matrix, ((0, 0), (0, 1)))


def turning(run: Run) -> tuple[Array, Array]:
    """Give the derivatives of `rigid.Apparent` in the steady turn by motion (15, 30) and rates (15, 9)."""
    apparent, steady = rigid.Apparent(run), np.zeros(39)
    steady[rigid.OMEGA] = rigid.equipment(run).Omega_DC
    step = 1e-6  # the differences of a quadratic are exact, whatever it is
    rows = []
    for change in step * np.eye(steady.size):
        above, below = (apparent(x[:30], x[30:]) for x in (steady + change, steady - change))
        rows.append(np.subtract(above, below) / (2 * step))
    J = np.array(rows).T
    return J[:, :30], J[:, 30:]


def response(run: Run, noise: signals.Noise | None = None) -> dict[str, Array]:
    """Give what the injections make of the channels, every second.

    Parameters
    ----------
    run : Run
        What is injected, and into what.
    noise : signals.Noise, optional
        To be there too; none otherwise.

    Returns
    -------
    dict of str to ndarray, shape (n_samples / 10,)
        Departures from the equilibrium of `System.channels`, SI.
    """
    s = system(run)
    stride = round(run.fs / RATE)
    n = run.n_samples // stride
    if not run.injections and noise is None:
        return {name: np.zeros(n) for name in s.channels}
    driving = (*_INJECTED, *s.inputs) if noise else _INJECTED
    columns = [i for i, name in enumerate(s.inputs) if name in driving]
    # one second at a time: its ten samples of injections together
    ahead = [s.B[:, columns]]
    for _ in range(stride - 1):
        ahead.append(s.A @ ahead[-1])
    pushes = np.concatenate([push.T for push in reversed(ahead)])
    A = np.linalg.matrix_power(s.A, stride)
    found = np.empty((n, len(s.channels)))
    state = np.zeros(len(A))
    for begin in range(0, n, BLOCK):
        end = min(begin + BLOCK, n)
        injected = signals.injections(run, begin * stride, end * stride)
        injected["f_x_1"] = injected["F_x_1"] / run.m_tm
        if noise:
            drawn = noise.take((end - begin) * stride)
            drawn["g_2"] -= run.dc  # the equilibrium holds it
            injected["f_x_1"] += drawn["f_x_1_jitter"]
            injected |= drawn
        still = np.zeros((end - begin) * stride)
        w = np.stack([injected.get(s.inputs[i], still) for i in columns], axis=1)
        track = np.empty((end - begin + 1, len(A)))
        track[0] = state
        for now, following, push in zip(
            track[:-1], track[1:], w.reshape(end - begin, -1) @ pushes, strict=True
        ):
            np.dot(A, now, out=following)
            following += push
        state = track[-1]
        found[begin:end] = track[:-1] @ s.C.T + w[::stride] @ s.D[:, columns].T
    return dict(zip(s.channels, found.T.copy(), strict=True))


def cross_spectra(run: Run, channels: Sequence[str], frequency: Array) -> Complex:
    """Give the cross-spectral matrices of the noise of channels, ``<x_i^* x_j>``, one-sided.

    Parameters
    ----------
    run : Run
        Where loop and noise come from.
    channels : sequence of str
        C of `System.channels`.
    frequency : ndarray, shape (n,)
        Hz.

    Returns
    -------
    ndarray, shape (n, C, C)
        Products of the units per Hz.
    """
    s = system(run)
    rows = [s.channels.index(name) for name in channels]
    H = transfer(s, run.h, frequency)[:, rows]
    psd = drive_psd(run, frequency)
    S = np.stack([psd.get(name, np.zeros(frequency.size)) for name in s.inputs], axis=1)
    return np.asarray(np.einsum("nik,nk,njk->nij", H.conj(), S, H, optimize=True))


def transfer(s: System, h: float, frequency: Array) -> Complex:
    """Give the frequency responses of the channels to the inputs, shape (n, channels, inputs).

    Parameters
    ----------
    s : System
        Of the loop.
    h : float
        Its sample time [s].
    frequency : ndarray, shape (n,)
        Hz.
    """
    z = np.exp(2j * np.pi * h * frequency)[:, np.newaxis, np.newaxis]
    return np.asarray(s.C @ np.linalg.solve(z * np.eye(len(s.A)) - s.A, s.B.astype(complex)) + s.D)


def drive_psd(run: Run, frequency: Array) -> dict[str, Array]:
    """Give the one-sided PSD of the noise that `signals` draws at inputs of the loop, each of shape (n,)."""
    found: dict[str, Array] = {}
    z = np.exp(2j * np.pi * run.h * frequency)
    for source in signals.sources(run):
        S = np.full(frequency.size, source.level**2)
        if source.corner:
            rho = np.exp(-2 * np.pi * source.corner * run.h)
            S *= np.abs(2 * np.pi * run.h / (1 - rho / z)) ** 2
        into = source.into.removesuffix("_jitter")
        found[into] = found.get(into, 0.0) + S
    return found
