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


def injections(run: Run) -> dict[str, Array]:
    """Injected signals of a run.

    Returns
    -------
    dict
        ``guidance_o_1``, ``guidance_o_12`` [m], ``F_x_1``, ``F_x_2`` [N], each of shape (n_samples,);
        overlapping injections add, a channel without any is exactly zero.
    """
    signals = {name: np.zeros(run.n_samples) for name in ("guidance_o_1", "guidance_o_12", "F_x_1", "F_x_2")}
    for injection in run.injections:
        first = int(np.ceil(injection.start * run.fs - 1e-6))  # rounding must not cost or add a sample
        stop = min(int(np.ceil(injection.end * run.fs - 1e-6)), run.n_samples)
        since = np.arange(first, stop) / run.fs - injection.start
        signal = signals[injection.into]
        if isinstance(injection, Sine):
            argument = 2 * np.pi * injection.frequency * since + injection.phase
            signal[first:stop] += injection.amplitude * np.sin(argument)
        else:
            ramp = 0.5 - 0.5 * np.cos(np.pi * since / (injection.end - injection.start))
            signal[first:stop] += injection.amplitude * ramp
            signal[stop:] += injection.amplitude
    return signals


def noise(run: Run) -> dict[str, Array]:
    """Noise of a run; a level of zero gives exact zeros.

    The noise of Delta g is shared in equal power by g_1 and g_2; g_2 also carries the constant ``run.dc``.

    Returns
    -------
    dict
        ``n_1``, ``n_12`` [m], ``g_1``, ``g_2`` [m s^-2], ``F_noise_x_sc`` [N], ``f_x_1_jitter`` [m s^-2],
        each of shape (n_samples,).
    """
    level = run.noise
    plateau = level.plateau / np.sqrt(2)
    tail = level.tail * TAIL_LEVEL * TAIL_FREQUENCY / np.sqrt(2)
    jitter = level.f_x_1_jitter * JITTER_FREQUENCY
    return {
        "n_1": _white(run, "n_1", level.oms),
        "n_12": _white(run, "n_12", level.oms),
        "g_1": _white(run, "g_1_plateau", plateau) + _red(run, "g_1_tail", tail, TAIL_CORNER),
        "g_2": _white(run, "g_2_plateau", plateau) + _red(run, "g_2_tail", tail, TAIL_CORNER) + run.dc,
        "F_noise_x_sc": _white(run, "F_noise_x_sc", level.thruster),
        "f_x_1_jitter": _red(run, "f_x_1_jitter", jitter, JITTER_CORNER),
    }


def _normal(run: Run, name: str) -> Array:
    digest = hashlib.sha256(f"{run.name}/{name}".encode()).digest()
    seed = np.random.SeedSequence([run.seed, *np.frombuffer(digest, dtype="<u4").tolist()])
    drawn: Array = np.random.default_rng(seed).standard_normal(run.n_samples)
    return drawn


def _white(run: Run, name: str, asd: float) -> Array:
    if asd == 0:
        return np.zeros(run.n_samples)
    return asd * math.sqrt(run.fs / 2) * _normal(run, name)


def _red(run: Run, name: str, slope: float, corner: float) -> Array:
    """Stationary first-order autoregression of ASD ``slope``/f between ``corner`` [Hz] and Nyquist."""
    if slope == 0:
        return np.zeros(run.n_samples)
    rho = np.exp(-2 * np.pi * corner * run.h)
    step = np.pi * slope * np.sqrt(2 * run.h)  # PSD 2 h step^2 / |1 - rho z^-1|^2 -> (slope / f)^2
    drawn = step * _normal(run, name)
    drawn[0] /= np.sqrt(1 - rho**2)  # the first sample already has the stationary variance
    red: Array = lfilter([1.0], [1.0, -rho], drawn)
    return red
