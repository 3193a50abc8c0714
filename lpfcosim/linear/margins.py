"""The control loops of a run in the frequency domain: unity gains and margins.

Everything is that of the sampled system, delays and holds included, with no command at its limit.
"""

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_GRID = np.geomspace(1e-6, 4.9, 700)  # Hz


@dataclass(frozen=True)
class Margin:
    """Where one of the loops crosses, all the others being closed.

    ``unity_gain`` [Hz] is the highest frequency of gain one, ``phase_margin`` [deg] the phase there above
    -180 deg; ``gain_margin`` [dB] is what the gain may rise before the loop turns unstable.
    """

    loop: str
    unity_gain: float
    phase_margin: float
    gain_margin: float


def margins(run: Run) -> list[Margin]:
    """Return unity gain, phase and gain margin of each loop, in the order of `ClosedLoop.loops`."""
    loop = ClosedLoop(run)
    all_cut = loop.loop_gain()

    def one_cut(log_frequency: ArrayLike) -> Complex:
        gain = all_cut.frequency_response(np.exp(log_frequency))
        sensitivity = np.linalg.inv(np.eye(len(loop.loops)) + gain)
        return np.asarray(1 / np.diagonal(sensitivity, axis1=1, axis2=2) - 1)

    grid = np.log(_GRID)
    L = one_cut(grid)
    return [_margin(name, i, one_cut, grid, L[:, i]) for i, name in enumerate(loop.loops)]


def _margin(name: str, i: int, one_cut: Callable[[ArrayLike], Complex], grid: Array, L: Complex) -> Margin:
    """Find where gain i, on the grid of log frequency ``L``, is one and where its phase is -180 deg."""

    def gain_at(log_frequency: float) -> complex:
        return complex(one_cut([log_frequency])[0, i])

    exceeds_unity = np.abs(L) > 1
    falls = np.flatnonzero(exceeds_unity[:-1] & ~exceeds_unity[1:])
    if not len(falls):
        return Margin(name, math.nan, math.inf, math.inf)
    root = scipy.optimize.brentq
    k = int(falls[-1])
    unity = float(root(lambda u: math.log(abs(gain_at(u))), grid[k], grid[k + 1]))
    turns = np.flatnonzero((np.diff(np.sign(L.imag)) != 0) & (L.real[:-1] < 0))
    crossings = [root(lambda u: gain_at(u).imag, grid[j], grid[j + 1]) for j in turns if j >= k]
    rise = [-20 * math.log10(abs(gain_at(u))) for u in crossings if u > unity]
    phase = math.degrees(cmath.phase(-gain_at(unity)))
    return Margin(name, math.exp(unity), phase, min(rise, default=math.inf))
