"""The loops of the whole spacecraft in the frequency domain: gains, margins, spectra.

Everything is that of the sampled system, delays and holds included, with no command at its limit.
"""

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from lpfcosim.plant.loops import (
    COMMANDS,
    INPUTS,
    LOOPS,
    READ_OUTS,
    actuation,
    applied,
    controllers,
    errors,
    loop,
    read_outs,
)
from lpfcosim.plant.rigid import ANGLES, DELAYED, MOTION, OMEGA, plant
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

CHANNELS = (*READ_OUTS, *COMMANDS, *MOTION, *(f"Omega_{k}" for k in ANGLES))
_GRID = np.geomspace(1e-6, 4.9, 700)  # Hz


@dataclass(frozen=True)
class Margin:
    """Where one of `loops.LOOPS` crosses, all the others being closed.

    ``unity_gain`` [Hz] is the highest frequency of gain one, ``phase_margin`` [deg] the phase there above
    -180 deg; ``gain_margin`` [dB] is what the gain may rise before the loop turns unstable.
    """

    loop: str
    unity_gain: float
    phase_margin: float
    gain_margin: float


def open_loop(run: Run, frequency: ArrayLike) -> Complex:
    """Loop gain of the sampled system, all loops cut at their errors.

    Returns
    -------
    ndarray, shape (n, 15, 15)
        L in error = -L error over `loops.LOOPS`; one loop with the others open is on the diagonal.
    """
    return _all_cut(run)(frequency)


def _all_cut(run: Run) -> Callable[[ArrayLike], Complex]:
    body = plant(run)
    into = body.B[:, DELAYED] @ applied(run)[0] @ actuation(run)
    out = np.zeros((len(LOOPS), len(body.A)))
    out[:, :15] = errors(run)[0] @ read_outs(run)
    A, B, C, D = controllers(run)

    def gain(frequency: ArrayLike) -> Complex:
        z = _z(run, frequency)
        response = out @ np.linalg.solve(z * np.eye(len(body.A)) - body.A, into)
        control = C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D
        return np.asarray(-response @ control)

    return gain


def margins(run: Run) -> list[Margin]:
    """Give unity gain, phase and gain margin of each loop, in the order of `loops.LOOPS`."""
    all_cut = _all_cut(run)

    def one_cut(log_frequency: ArrayLike) -> Complex:
        sensitivity = np.linalg.inv(np.eye(len(LOOPS)) + all_cut(np.exp(log_frequency)))
        return np.asarray(1 / np.diagonal(sensitivity, axis1=1, axis2=2) - 1)

    grid = np.log(_GRID)
    L = one_cut(grid)
    return [_margin(i, one_cut, grid, L[:, i]) for i in range(len(LOOPS))]


def _margin(i: int, one_cut: Callable[[ArrayLike], Complex], grid: Array, L: Complex) -> Margin:
    """Find where gain i, on the grid of log frequency ``L``, is one and where its phase is -180 deg."""

    def at(log_frequency: float) -> complex:
        return complex(one_cut([log_frequency])[0, i])

    above = np.abs(L) > 1
    falls = np.flatnonzero(above[:-1] & ~above[1:])
    if not len(falls):
        return Margin(LOOPS[i], math.nan, math.inf, math.inf)
    k = int(falls[-1])
    unity = float(brentq(lambda u: math.log(abs(at(u))), grid[k], grid[k + 1]))
    turns = np.flatnonzero((np.diff(np.sign(L.imag)) != 0) & (L.real[:-1] < 0))
    crossings = [brentq(lambda u: at(u).imag, grid[j], grid[j + 1]) for j in turns if j >= k]
    rise = [-20 * math.log10(abs(at(u))) for u in crossings if u > unity]
    phase = math.degrees(cmath.phase(-at(unity)))
    return Margin(LOOPS[i], math.exp(unity), phase, min(rise, default=math.inf))


def transfer(run: Run, frequency: ArrayLike) -> Complex:
    """From `loops.INPUTS` to `CHANNELS` in the linear closed loop, shape (n, 56, 45)."""
    step = loop(run)
    z = _z(run, frequency)
    n = len(step.A)
    C = np.vstack([step.C_o, step.C_u, np.eye(15, n), np.eye(3, n, OMEGA.start)])
    direct = np.vstack([np.eye(len(READ_OUTS), len(INPUTS)), step.D_u, np.zeros((18, len(INPUTS)))])
    into = step.B + step.B_u @ step.D_u
    response = C @ np.linalg.solve(z * np.eye(n) - step.closed, into) + direct
    return np.asarray(response)


def spectra(run: Run, frequency: ArrayLike, psd: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Give the stationary PSD of `CHANNELS` [unit^2 Hz^-1], one-sided, for that of some of `loops.INPUTS`.

    Parameters
    ----------
    run : Run
        Where the loop comes from; its quadratic terms are left out.
    frequency : array_like, shape (n,)
        Hz.
    psd : mapping of str to array_like, scalar or of shape (n,)
        One-sided PSD of independent inputs by name; what is missing is quiet.
    """
    H = transfer(run, frequency)
    n = len(H)
    S = np.stack([np.broadcast_to(np.asarray(psd.get(name, 0.0), dtype=float), n) for name in INPUTS], axis=1)
    power = np.einsum("noi,ni->on", np.abs(H) ** 2, S)
    return dict(zip(CHANNELS, power, strict=True))


def _z(run: Run, frequency: ArrayLike) -> Complex:
    z = np.exp(2j * np.pi * run.h * np.asarray(frequency, dtype=float))
    return np.asarray(z[:, np.newaxis, np.newaxis])
