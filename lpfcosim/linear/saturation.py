"""Commands at the limit of their authority: there the loop is not the linear one that is fitted."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.requirements import GAP_TAPER, TAPER
from lpfcosim.linear import response
from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.linear.state_space import StateSpace
from lpfcosim.models import model_of
from lpfcosim.spacecraft import READ_OUT_RANGE, Actuation, HalfCosine, Injection, Run, Sine

Array = NDArray[np.float64]

AT_LIMIT = 1 - 1e-12  # of the authority, rounding apart
REACH = 15.0  # s on either side of a sample at its limit that filter and stencils of a fit reach
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
    injection : Injection or None
        The one with most to do with the peak; None if there is none at that time.
    """

    channel: str
    is_read_out: bool
    peak: float
    limit: float
    rms: float
    time: float
    share: float
    injection: Injection | None


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
    gains, rms = _gains(run, system, list(limits))
    start = loop.equilibrium()
    if all(
        abs(start[name]) + _bound(run, gains[name]) + _SIGMAS * rms[name] < limit
        for name, limit in limits.items()
    ):
        return []
    moved = response.linear_response(run, channels=list(limits))
    exceeded = []
    for name, limit in limits.items():
        size = np.abs(moved[name] + start[name])
        share = _share_beyond(size, limit, rms[name])
        if share * run.n_samples >= 1:
            peak = int(np.argmax(size))
            time = peak / response.RATE
            injection = _dominant_injection(run, gains[name], time)
            is_read_out = name in spacecraft.read_outs
            exceeded.append(
                Demand(name, is_read_out, float(size[peak]), limit, rms[name], time, share, injection)
            )
    return exceeded


def masked_share(run: Run) -> float:
    """Return the fraction of a run, as its window counts it, that a fit would mask for saturation.

    The run is simulated from the equations of its models, whose commands have their limits.

    Raises
    ------
    DivergenceError
        If a read-out leaves its range.
    """
    loop = ClosedLoop(run)
    channels, limits = loop.simulate(), loop.limits
    commands = [name for name in model_of(run).commands if name in limits]
    limited = np.any([np.abs(channels[name]) >= limits[name] * AT_LIMIT for name in commands], axis=0)
    if not limited.any():
        return 0.0
    whole = scipy.signal.windows.tukey(run.n_samples, TAPER) ** 2
    distance = scipy.ndimage.distance_transform_edt(~limited) / run.fs - REACH
    notch = np.sin(np.pi / 2 * np.clip(distance / GAP_TAPER, 0, 1)) ** 4
    return float(1 - np.sum(whole * notch) / np.sum(whole))


def _gains(
    run: Run, system: StateSpace, names: Sequence[str]
) -> tuple[dict[str, dict[str, Array]], dict[str, float]]:
    """Return the gain of channels by input over `_GRID`, and the rms of their noise."""
    H = system.select(system.inputs, names).frequency_response(_GRID)
    # noise of the electrodes, which takes a response of its own, hardly adds to the commands
    weights, psd = response.noise_streams(replace(run, actuation=Actuation()), system, _GRID)
    power = np.abs(H @ weights) ** 2 @ psd[:, :, None]
    rms = np.sqrt(np.trapezoid(power[:, :, 0], _GRID, axis=0))
    size = np.abs(H)
    gains = {
        name: {entry: size[:, i, k] for k, entry in enumerate(system.inputs)} for i, name in enumerate(names)
    }
    return gains, dict(zip(names, map(float, rms), strict=True))


def _bound(run: Run, gains: Mapping[str, Array]) -> float:
    """Return what all injections together hardly reach."""
    return sum(_TRANSIENT * abs(i.amplitude) * float(gains[i.into].max()) for i in run.injections)


def _share_beyond(size: Array, limit: float, rms: float) -> float:
    """Return the expected fraction of samples beyond a limit, of a magnitude with normal noise on it."""
    if rms == 0:
        return float(np.mean(size > limit))
    tails = scipy.special.ndtr((size - limit) / rms) + scipy.special.ndtr(-(size + limit) / rms)
    return float(np.mean(tails))


def _dominant_injection(run: Run, gains: Mapping[str, Array], time: float) -> Injection | None:
    """Return the injection that moves a channel most of those that act at a time or have begun before it."""

    def effect(injection: Injection) -> float:
        gain = gains[injection.into]
        at = injection.frequency if isinstance(injection, Sine) else _GRID[0]
        return abs(injection.amplitude) * float(np.interp(at, _GRID, gain))

    begun = [i for i in run.injections if i.start <= time + 1]
    acting = [i for i in begun if isinstance(i, HalfCosine) or i.end >= time] or begun[-1:]
    return max(acting, key=effect, default=None)
