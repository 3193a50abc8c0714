"""What drives a run: injections, and noise seeded by name so that the order of drawing never matters."""

import hashlib
import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from lpfcosim.run import Run, Sine

TAIL_LEVEL, TAIL_FREQUENCY, TAIL_CORNER = 60e-15, 20e-6, 2e-6  # m s^-2 Hz^-0.5 at Hz; flat below (choice)
JITTER_FREQUENCY, JITTER_CORNER = 1e-3, 0.1e-3  # Hz; flat below the corner (choice)

Array = NDArray[np.float64]


NOISES = ("n_1", "n_12", "g_1", "g_2", "F_noise_x_sc", "f_x_1_jitter")
TARGETS = ("guidance_o_1", "guidance_o_12", "F_x_1", "F_x_2")


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
        ``guidance_o_1``, ``guidance_o_12`` [m], ``F_x_1``, ``F_x_2`` [N], each of shape (stop - start,);
        overlapping injections add, a channel without any is exactly zero.
    """
    stop = run.n_samples if stop is None else stop
    signals = {name: np.zeros(stop - start) for name in TARGETS}
    for injection in run.injections:
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

    The noise of Delta g is shared in equal power by g_1 and g_2; g_2 also carries the constant ``run.dc``.

    Parameters
    ----------
    run : Run
        Its name, seed and levels.
    """

    def __init__(self, run: Run) -> None:
        level = run.noise
        plateau = level.plateau / np.sqrt(2)
        tail = level.tail * TAIL_LEVEL * TAIL_FREQUENCY / np.sqrt(2)
        jitter = level.f_x_1_jitter * JITTER_FREQUENCY
        self._dc = run.dc
        self._white = {
            "n_1": _White(run, "n_1", level.oms),
            "n_12": _White(run, "n_12", level.oms),
            "g_1": _White(run, "g_1_plateau", plateau),
            "g_2": _White(run, "g_2_plateau", plateau),
            "F_noise_x_sc": _White(run, "F_noise_x_sc", level.thruster),
        }
        self._red = {
            "g_1": _Red(run, "g_1_tail", tail, TAIL_CORNER),
            "g_2": _Red(run, "g_2_tail", tail, TAIL_CORNER),
            "f_x_1_jitter": _Red(run, "f_x_1_jitter", jitter, JITTER_CORNER),
        }

    def take(self, n: int) -> dict[str, Array]:
        """Draw the next ``n`` samples.

        Returns
        -------
        dict
            ``n_1``, ``n_12`` [m], ``g_1``, ``g_2`` [m s^-2], ``F_noise_x_sc`` [N], ``f_x_1_jitter``
            [m s^-2], each of shape (n,).
        """
        drawn = {name: np.zeros(n) for name in NOISES}
        for sources in (self._white, self._red):
            for name, source in sources.items():
                drawn[name] += source.take(n)
        drawn["g_2"] += self._dc
        return drawn


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
        red, self._state = lfilter([1.0], [1.0, -self._rho], drawn, zi=self._state)
        return np.asarray(red)
