"""Sampled loops: control laws, one step of plant and controllers, and the linear system it is when closed."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lpfcosim.errors import DivergenceError
from lpfcosim.spacecraft import READ_OUT_RANGE, Controller, Lead, Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

BLOCK = 6000  # samples between two looks at the read-out range


@dataclass(frozen=True)
class Loop:
    """One step of plant and controllers around the commands, which authority may clip.

    ``state+ = A state + B w + B_u u`` with w = ``inputs``, u = ``commands``; the controllers ask for
    ``u = C_u state + D_u w + u_start``; the rows of ``C state + D w`` are the ``read_outs``; SI.
    """

    inputs: tuple[str, ...]
    commands: tuple[str, ...]
    read_outs: tuple[str, ...]
    A: Array
    B: Array
    B_u: Array
    C_u: Array
    D_u: Array
    u_start: Array
    C: Array
    D: Array
    start: Array

    @property
    def closed(self) -> Array:
        """State matrix of the linear closed loop, no command at its limit."""
        return self.A + self.B_u @ self.C_u


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


def linear(step: Loop, run: Run, leak: Array) -> System:
    """Close a loop, with no command at its limit; ``leak``: of each command into the channel f_x_1."""
    inputs = (*step.inputs, "F_x_2")
    B, D, D_u = (with_none(matrix) for matrix in (step.B, step.D, step.D_u))
    D_u[step.commands.index("f_x_2"), -1] = 1 / run.m_tm
    f_x_1 = np.array([float(name == "f_x_1") for name in inputs])
    return System(
        A=step.closed,
        B=B + step.B_u @ D_u,
        C=np.vstack([step.C, step.C_u, leak @ step.C_u]),
        D=np.vstack([D, D_u, f_x_1 + leak @ D_u]),
        inputs=inputs,
        channels=(*step.read_outs, *step.commands, "f_x_1"),
    )


def with_none(matrix: Array) -> Array:
    """Add a column for the last input of a `System`, which does nothing here."""
    return np.pad(matrix, ((0, 0), (0, 1)))


def held(rates: Array, times: ArrayLike) -> Array:
    """Solve x' = A x + B u exactly, with u held.

    SciPy has an exponential too, but takes longer to be read in than a campaign.

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
    n, t = len(rates), np.asarray(times, dtype=float)[:, np.newaxis, np.newaxis]
    z = rates[:, :n] * t
    halvings = max(math.ceil(math.log2(np.abs(z).sum(axis=-1).max() + 1)) - 1, 0)
    z /= 2**halvings
    # mean of exp(z s) over 0 < s < 1, which is 1 + z/2 + z^2/6 ...; the norm of z is at most 2
    mean = one = np.eye(n)
    for k in range(25, 1, -1):
        mean = one + z @ mean / k
    for _ in range(halvings):
        mean = mean + z @ mean @ mean / 2
        z *= 2
    return np.concatenate([one + z @ mean, t * (mean @ rates[:, n:])], axis=-1)


def block_diagonal(*blocks: Array) -> Array:
    """Put square matrices on the diagonal of one."""
    ends = np.cumsum([len(block) for block in blocks])
    joined = np.zeros((ends[-1], ends[-1]))
    for end, block in zip(ends, blocks, strict=True):
        joined[end - len(block) : end, end - len(block) : end] = block
    return joined


def sampled(law: Controller, h: float) -> tuple[Array, Array, float]:
    """Discretise K(s) = sum r_i / (s + p_i) with the bilinear rule.

    Returns
    -------
    decay, entry : ndarray, shape (3,)
        ``state+ = decay * state + entry * e``, one state per pole.
    direct : float
        ``K e = sum(state) + direct * e``.
    """
    p, r = np.array(law.rates), np.array(law.residues)
    decay = (2 - p * h) / (2 + p * h)
    direct = r * h / (2 + p * h)
    return decay, direct * (1 + decay), float(direct.sum())


def sampled_lead(law: Lead, h: float) -> tuple[Array, Array, Array, float]:
    """Discretise three lags in a row, k (p u_2 + (z - p) u_3), with the bilinear rule.

    Returns
    -------
    A, B, C, D : ndarray, shapes (3, 3), (3,), (3,), and float
        ``state+ = A state + B e``, ``output = C state + D e``.
    """
    p, z = 2 * np.pi * law.pole, 2 * np.pi * law.zero
    decay, entry = (1 - h * p / 2) / (1 + h * p / 2), h * p / 2 / (1 + h * p / 2)
    # u_i = state_i + entry u_(i-1), u_0 = e: rows of u_1, u_2, u_3 over (states, e)
    u = np.array(
        [[entry ** (i - j) if j <= i else 0.0 for j in range(3)] + [entry ** (i + 1)] for i in range(3)]
    )
    into = np.vstack([[0, 0, 0, 1], u[:2]])
    following = decay * np.eye(3, 4) + (1 + decay) * entry * into
    out = law.gain * (p * u[1] + (z - p) * u[2])
    return following[:, :3], following[:, 3], out[:3], float(out[3])


def on_circle(frequency: ArrayLike, h: float) -> Complex:
    """Give z = exp(2 pi i f h) of frequencies [Hz], shape (n, 1, 1)."""
    return np.asarray(np.exp(2j * np.pi * h * np.asarray(frequency, dtype=float))[:, np.newaxis, np.newaxis])


def check_inside(run: Run, o_1: Array, o_12: Array, begin: int) -> None:
    """Refuse interferometer read-outs beyond their range; ``begin``: number of their first sample.

    Raises
    ------
    DivergenceError
        Gives the channel and the time.
    """
    lost = ~(np.abs([o_1, o_12]) <= READ_OUT_RANGE)  # true for NaN too
    if lost.any():
        i = int(lost.any(axis=0).argmax())
        channel = "o_1" if lost[0, i] else "o_12"
        time = (begin + i) / run.fs
        cause = f"the loop diverged, {channel} left +-{READ_OUT_RANGE:g} m at t = {time:g} s"
        raise DivergenceError(run.name, cause)
