"""What drives a run: injections, and noise seeded by name so that the order of drawing never matters."""

import hashlib
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.spacecraft import Pulse, Run, Sine

TAIL_LEVEL, TAIL_FREQUENCY, TAIL_CORNER = 60e-15, 20e-6, 2e-6  # m s^-2 Hz^-0.5 at Hz; flat below (choice)
JITTER_FREQUENCY, JITTER_CORNER = 1e-3, 0.1e-3  # Hz; flat below the corner (choice)

Array = NDArray[np.float64]


TARGETS = ("guidance_o_1", "guidance_o_12", "F_x_1", "F_x_2")
_NOISES = ("n_1", "n_12", "g_1", "g_2", "F_noise_x_sc", "f_x_1_jitter")
_ATTITUDE = ("attitude_theta", "attitude_eta", "attitude_phi")
_GRS_KNEE, _TORQUE_KNEE = 1e-3, 0.2e-3  # Hz, below them sensing and torque noise rise as 1/f
_THRUSTER_KNEE = {"cold gas": 0.0, "colloid": 1e-3}  # Hz


def names(run: Run) -> tuple[str, ...]:
    """Every signal that drives a run, injections first."""
    whole = dict.fromkeys(source.into for source in _whole(run))
    return (*TARGETS, *_NOISES, *(_ATTITUDE if run.spacecraft else ()), *whole)


def injections(run: Run, start: int = 0, stop: int | None = None) -> dict[str, Array]:
    """Injected signals of a run.

    Parameters
    ----------
    run : Run
        What is injected.
    start, stop : int
        The samples wanted, all by default; any division of a run into blocks gives the same values.

    Returns
    -------
    dict
        ``guidance_o_1``, ``guidance_o_12`` [m], ``F_x_1``, ``F_x_2`` [N], and of the whole spacecraft the set
        points ``attitude_theta``, ``attitude_eta``, ``attitude_phi`` [rad], each of shape (stop - start,);
        overlapping injections add, a channel without any is exactly zero.
    """
    stop = run.n_samples if stop is None else stop
    signals = {name: np.zeros(stop - start) for name in TARGETS}
    for injection in run.injections:
        if isinstance(injection, Pulse):
            continue  # no command, see `Noise`
        first = _clip(_sample(run, injection.start), start, stop)
        last = _clip(_sample(run, injection.end), start, stop)
        since = np.arange(first, last) / run.fs - injection.start
        signal = signals[injection.into]
        if isinstance(injection, Sine):
            argument = 2 * np.pi * injection.frequency * since + injection.phase
            signal[first - start : last - start] += injection.amplitude * np.sin(argument)
        else:
            ramp = 0.5 - 0.5 * np.cos(np.pi * since / (injection.end - injection.start))
            signal[first - start : last - start] += injection.amplitude * ramp
            signal[last - start :] += injection.amplitude
    if run.spacecraft:
        time = np.arange(start, stop) / run.fs
        signals |= {name: rate * time for name, rate in zip(_ATTITUDE, run.spacecraft.Omega_DC, strict=True)}
    return signals


def _sample(run: Run, time: float) -> int:
    return int(np.ceil(time * run.fs - 1e-6))  # rounding must not cost or add a sample


def _clip(sample: int, start: int, stop: int) -> int:
    return min(max(sample, start), stop)


def noise(run: Run) -> dict[str, Array]:
    """Draw the noise of a whole run; see `Noise`."""
    return Noise(run).take(run.n_samples)


class Noise:
    """Noise of a run, drawn in blocks of any size to the same bits; a level of zero gives exact zeros.

    The noise of Delta g is shared in equal power by g_1 and g_2; g_2 also carries the constant ``run.dc``,
    and both the injected pulses.

    Parameters
    ----------
    run : Run
        Its name, seed and levels.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._drawn = 0
        self._names = [name for name in names(run) if name not in (*TARGETS, *_ATTITUDE)]
        self._sources = [(source.into, source.start(run)) for source in sources(run)]

    def take(self, n: int) -> dict[str, Array]:
        """Draw the next ``n`` samples.

        Returns
        -------
        dict
            Every signal of `names` that is noise, SI, each of shape (n,).
        """
        drawn = {name: np.zeros(n) for name in self._names}
        for into, source in self._sources:
            drawn[into] += source.take(n)
        drawn["g_2"] += self._run.dc
        first, self._drawn = self._drawn, self._drawn + n
        for pulse in self._run.injections:
            if isinstance(pulse, Pulse):
                begin = _clip(_sample(self._run, pulse.start), first, first + n)
                end = _clip(_sample(self._run, pulse.end), first, first + n)
                phase = (np.arange(begin, end) / self._run.fs - pulse.start) / pulse.duration
                drawn[pulse.into][begin - first : end - first] += pulse.amplitude * np.sin(np.pi * phase) ** 2
        return drawn


@dataclass(frozen=True)
class Source:
    """A stream of noise: white of ASD ``level``, or with a ``corner`` [Hz] of ASD ``level``/f above it."""

    name: str
    into: str
    level: float
    corner: float = 0.0

    def start(self, run: Run) -> "_White | _Red":
        """Return the stream at its beginning."""
        if self.corner:
            return _Red(run, self.name, self.level, self.corner)
        return _White(run, self.name, self.level)


def sources(run: Run) -> tuple[Source, ...]:
    """Every stream of noise that drives a run."""
    return (*_along_x(run), *_whole(run))


def _along_x(run: Run) -> tuple[Source, ...]:
    noise = run.noise
    plateau = noise.plateau / math.sqrt(2)
    tail = noise.tail * TAIL_LEVEL * TAIL_FREQUENCY / math.sqrt(2)
    jitter = noise.f_x_1_jitter * JITTER_FREQUENCY
    return (
        Source("n_1", "n_1", noise.oms),
        Source("n_12", "n_12", noise.oms),
        Source("g_1_plateau", "g_1", plateau),
        Source("g_2_plateau", "g_2", plateau),
        Source("F_noise_x_sc", "F_noise_x_sc", noise.thruster),
        *_tail("F_noise_x_sc", noise.thruster, _THRUSTER_KNEE[noise.thrusters]),
        Source("g_1_tail", "g_1", tail, TAIL_CORNER),
        Source("g_2_tail", "g_2", tail, TAIL_CORNER),
        Source("f_x_1_jitter", "f_x_1_jitter", jitter, JITTER_CORNER),
    )


def _whole(run: Run) -> tuple[Source, ...]:
    """Noise beyond the x axis; a level with a knee rises as 1/f below it."""
    if run.spacecraft is None:
        return ()
    noise, axes, angles = run.noise, ("x", "y", "z"), ("theta", "eta", "phi")
    levels = [(f"n_{k}_{j}", noise.dws, 0.0) for k in ("phi", "eta") for j in (1, 12)]
    levels += [(f"n_grs_{k}_{j}", noise.grs, _GRS_KNEE) for j in (1, 2) for k in axes]
    levels += [(f"n_grs_{k}_{j}", noise.grs_angle, _GRS_KNEE) for j in (1, 2) for k in angles]
    levels += [(f"n_ast_{k}", getattr(noise, f"star_tracker_{k}"), 0.0) for k in angles]
    knee = _THRUSTER_KNEE[noise.thrusters]
    levels += [(f"F_noise_{k}_sc", noise.thruster, knee) for k in ("y", "z")]
    levels += [(f"N_noise_{k}_sc", noise.thruster_torque, knee) for k in axes]
    levels += [(f"g_{k}_{j}", noise.lateral, 0.0) for j in (1, 2) for k in ("y", "z")]
    levels += [(f"gamma_{k}_{j}", noise.torque, _TORQUE_KNEE) for j in (1, 2) for k in angles]
    sources = []
    for name, level, knee in levels:
        sources += [Source(name, name, level), *_tail(name, level, knee)]
    return tuple(sources)


def _tail(name: str, level: float, knee: float) -> tuple[Source, ...]:
    """1/f noise that meets a white level at the knee [Hz]; none without one."""
    return (Source(f"{name}_tail", name, level * knee, TAIL_CORNER),) if knee else ()


class _White:
    """White noise of one-sided ASD ``asd``."""

    def __init__(self, run: Run, name: str, asd: float) -> None:
        digest = hashlib.sha256(f"{run.name}/{name}".encode()).digest()
        seed = np.random.SeedSequence([run.seed, *np.frombuffer(digest, dtype="<u4").tolist()])
        self._generator = np.random.default_rng(seed)
        self._size = asd * math.sqrt(run.fs / 2)

    def take(self, n: int) -> Array:
        if self._size == 0:
            return np.zeros(n)
        drawn: Array = self._size * self._generator.standard_normal(n)
        return drawn


class _Red:
    """Stationary first-order autoregression of ASD ``slope``/f between ``corner`` [Hz] and Nyquist."""

    def __init__(self, run: Run, name: str, slope: float, corner: float) -> None:
        # PSD 2 h step^2 / |1 - rho z^-1|^2 -> (slope / f)^2, with step = pi slope sqrt(2 h)
        self._source = _White(run, name, 2 * math.pi * slope * run.h)
        self._rho = math.exp(-2 * math.pi * corner * run.h)
        self._state: Array | None = None

    def take(self, n: int) -> Array:
        drawn = self._source.take(n)
        if self._state is None:
            if n:
                drawn[0] /= math.sqrt(1 - self._rho**2)  # the first sample has the stationary variance
            self._state = np.zeros(1)
        red, self._state = scipy.signal.lfilter([1.0], [1.0, -self._rho], drawn, zi=self._state)
        return np.asarray(red)
