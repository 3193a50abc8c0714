"""Commands and read-outs at their limits: there the loop is not the linear one that is fitted."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.linear import response
from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.models import ELECTRODES, model_of
from lpfcosim.spacecraft import READ_OUT_RANGE, Run

Array = NDArray[np.float64]

AT_LIMIT = 1 - 1e-12  # of the authority, rounding apart
_GRID = np.geomspace(1e-5, 4.9, 80)  # Hz
_TRANSIENT = 4.0  # over the largest gain at any frequency: what switching an injection on may add
_SIGMAS = 6.0  # of noise, beyond which no sample of a run is expected


@dataclass(frozen=True)
class Demand:
    """A channel that the linear loop, which knows no limits, takes beyond what is possible.

    Attributes
    ----------
    channel : str
        A command or a read-out, such as ``f_x_2`` [m s^-2] or ``o_12`` [m].
    is_read_out : bool
        Whether its limit is the range of a read-out; otherwise it is the authority of a command.
    peak, limit : float
        Its largest magnitude without noise, and the largest that there is, in the unit of the channel.
    rms : float
        Of its noise, in the same unit.
    time : float
        Of the peak, since the start of the run [s].
    share : float
        Expected fraction of the samples beyond the limit.
    """

    channel: str
    is_read_out: bool
    peak: float
    limit: float
    rms: float
    time: float
    share: float


def count(limits: Mapping[str, float], block: Mapping[str, Array]) -> int:
    """Count the samples of a block in which a command is at its limit, see `ClosedLoop.limits`."""
    reached = [np.abs(block[name]) >= limit * AT_LIMIT for name, limit in limits.items() if name in block]
    return int(np.any(reached, axis=0).sum())


def demands(run: Run, commands: Collection[str] | None = None) -> list[Demand]:
    """Return the commands and the read-outs that a run takes beyond their limits.

    Injections, the force that holds `Run.dc` and the stationary noise count. A limit is exceeded if one
    sample or more of the run is expected beyond it. The loop must be stable.

    Parameters
    ----------
    run : Run
        What is injected, and into what.
    commands : collection of str, optional
        The commands that count, by default those along sensitive axes.
    """
    loop, spacecraft = ClosedLoop(run), model_of(run)
    system = loop.linearize()
    commands = spacecraft.commands if commands is None else commands
    limits = {name: limit for name, limit in loop.limits.items() if name in commands}
    limits |= dict.fromkeys(spacecraft.read_outs, READ_OUT_RANGE)
    gain = system.select(system.inputs, list(limits)).frequency_response(_GRID)
    # noise of the electrodes, which takes a response of its own, hardly adds to the commands
    weights, psd = response.noise_streams(run.without_noise(*ELECTRODES), system, _GRID)
    power = (np.abs(gain @ weights) ** 2 @ psd[:, :, None])[:, :, 0]
    rms = dict(zip(limits, np.sqrt(np.trapezoid(power, _GRID, axis=0)), strict=True))
    start, largest = loop.equilibrium(), np.abs(gain).max(axis=0)
    driven = sum(abs(i.amplitude) * largest[:, system.inputs.index(i.into)] for i in run.injections)
    bound = dict(zip(limits, _TRANSIENT * driven * np.ones(len(limits)), strict=True))
    if all(abs(start[x]) + bound[x] + _SIGMAS * rms[x] < limit for x, limit in limits.items()):
        return []
    responses = response.linear_response(run, channels=list(limits))
    exceeded = []
    for name, limit in limits.items():
        size = np.abs(responses[name] + start[name])
        share = _share_beyond(size, limit, rms[name])
        if share * run.n_samples >= 1:
            peak, is_read_out = int(np.argmax(size)), name in spacecraft.read_outs
            time = peak / response.RATE
            demand = Demand(name, is_read_out, float(size[peak]), limit, float(rms[name]), time, share)
            exceeded.append(demand)
    return exceeded


def _share_beyond(size: Array, limit: float, rms: float) -> float:
    """Return the expected fraction of samples beyond a limit, of a magnitude with normal noise on it."""
    if rms == 0:
        return float(np.mean(size > limit))
    tails = scipy.special.ndtr((size - limit) / rms) + scipy.special.ndtr(-(size + limit) / rms)
    return float(np.mean(tails))
