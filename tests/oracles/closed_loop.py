"""Telemetry of one run of a controlled spacecraft along x: an oracle that shares no code with what it checks.

Everything is linear and sampled at 10 Hz, so that each Fourier component is solved for in closed form: the
z-transforms of two test masses under held and delayed forces, closed by a drag-free and a suspension loop.
The solution is periodic over the run and some hours more, of which the run is a part, and holds for the ramp
of test mass 1 as it does for tones. What is not linear joins as a small force that the telemetry does not
show.

``x_j'' = g_j - omega2_j x_j + lambda_j f_x_j(t - tau_j) - a_SC``, ``o_12 = x_2 - x_1 + delta_ifo x_1``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len

HOLD = 0.1  # s
BEFORE, AFTER = 7200.0, 14400.0  # s of the period before and after the run
BAND = 0.2, 0.5  # Hz: the archive at 1 Hz is flat up to the first and has nothing above the second
THRUSTER_DELAY = 0.35  # s, without the hold
MASS, SPACECRAFT = 1.928, 422.7  # kg

Array = np.ndarray
#: From times since the start [s] and channels as they come out to forces that act and are not in the
#: telemetry: on test mass 1 and on test mass 2, both through their actuators, and differential [m s^-2].
Hidden = Callable[[Array, dict[str, Array]], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Plant:
    """The truth of one run; `delay` is effective, that is transport and half a hold [s]."""

    lambda_1: float
    lambda_2: float
    delay_1: float
    delay_2: float
    omega2_1: float
    omega2_2: float
    delta_ifo: float


@dataclass(frozen=True)
class Noise:
    """Amplitude spectral densities; `tail` is in units of 60 fm s^-2 Hz^-1/2 at 20 uHz, falling as 1/f."""

    plateau: float = 4e-15  # m s^-2 Hz^-1/2
    tail: float = 1.2
    oms: float = 35e-15  # m Hz^-1/2
    thruster: float = 0.15e-6  # N Hz^-1/2
    jitter: float = 1e-14  # m s^-2 Hz^-1/2 of f_x_1 at 1 mHz, as f^-1/2
    balance: float = 0.0  # m s^-2, constant


@dataclass(frozen=True)
class Drive:
    """What is injected: (start [s], f [Hz], amplitude, cycles) of guidance [m] and of f_x_1 [m s^-2].

    `ramp` is (begin [s], end [s], f_x_1 [m s^-2]) of a half cosine with an equal force on test mass 2.
    """

    guidance_1: tuple[tuple[float, float, float, float], ...] = ()
    guidance_12: tuple[tuple[float, float, float, float], ...] = ()
    force_1: tuple[tuple[float, float, float, float], ...] = ()
    ramp: tuple[float, float, float] | None = None


def _response(q: Array, omega2: float, delay: float) -> Array:
    """Return x(z)/a(z) of x'' = -omega2 x + a, a held for 0.1 s and late by `delay`; q = 1/z."""
    whole, part = divmod(delay / HOLD + 1e-12, 1.0)
    k = np.sqrt(complex(-omega2)) * HOLD

    def step(n: float) -> complex:  # (cosh(k n) - 1) / k^2 in units of the hold
        return (2 * (np.sinh(k * n / 2) / k) ** 2 if abs(k) > 1e-12 else 0.5 * n**2) * (n > 0)

    x = [step(n - part) - step(n - 1 - part) for n in (1, 2, 3)]
    c = 2 * np.cosh(k)
    numerator = q * x[0] + q**2 * (x[1] - c * x[0]) + q**3 * (x[2] - c * x[1] + x[0])
    # 1 - c q + q^2 without the cancellation at low frequency
    denominator = q * (-4 * np.sin(np.angle(q) / 2) ** 2 - 4 * np.sinh(k / 2) ** 2)
    return q**whole * numerator / denominator * HOLD**2


def _controller(q: Array, unity: float, zeros: tuple[float, float], poles: tuple[float, float]) -> Array:
    """Return k (s + wz)(s + wi) / [s (1 + s/wp)(1 + s/wr)] by the bilinear rule, |K/s^2| = 1 at `unity`."""

    def shape(s: Array) -> Array:
        above = (s + 2 * np.pi * zeros[0]) * (s + 2 * np.pi * zeros[1])
        return above / (s * (1 + s / (2 * np.pi * poles[0])) * (1 + s / (2 * np.pi * poles[1])))

    s_1 = np.array([2j * np.pi * unity])
    return shape(2 / HOLD * (1 - q) / (1 + q)) * np.abs(s_1**2 / shape(s_1))[0]


def _sines(time: Array, tones: tuple[tuple[float, float, float, float], ...]) -> Array:
    values = np.zeros(time.size)
    for start, f, amplitude, cycles in tones:
        on = (time >= start) & (time < start + cycles / f)
        values[on] += amplitude * np.sin(2 * np.pi * f * (time[on] - start))
    return values


def _ramp(time: Array, ramp: tuple[float, float, float] | None, duration: float) -> Array:
    """Rise as asked, and fall again once the run is over."""
    if ramp is None:
        return np.zeros(time.size)
    begin, end, height = ramp

    def rise(start: float, stop: float) -> Array:
        return 0.5 - 0.5 * np.cos(np.pi * np.clip((time - start) / (stop - start), 0, 1))

    return height * (rise(begin, end) - rise(duration, duration + 9000.0))


class _Draw:
    """Fourier amplitudes of independent noises with given densities, the same whatever the sample rate."""

    def __init__(self, f: Array, period: float, seed: list[int]) -> None:
        self.f, self.period, self.seed, self.count = f, period, seed, 0

    def __call__(self, density: Array | float) -> Array:
        self.count += 1
        normal = np.random.default_rng([*self.seed, self.count]).standard_normal((self.f.size, 2))
        drawn = (normal[:, 0] + 1j * normal[:, 1]) * density / np.sqrt(4 * self.period)
        drawn[0] = 0
        return drawn


@dataclass(frozen=True)
class _Inputs:
    """Fourier amplitudes of what comes from outside the loops: guidance, forces, noise."""

    guidance_1: Array
    guidance_12: Array
    f_1: Array
    ahead: Array  # on test mass 2, against the ramp
    g_1: Array
    g_2: Array
    n_1: Array
    n_12: Array


def _solve(
    plant: Plant, q: Array, at: _Inputs, e_1: Array | float, e_2: Array | float, e_12: Array | float
) -> dict[str, Array]:
    """Return the amplitudes of the channels; the last three are what is hidden."""
    drag_free = _controller(q, 0.09, (0.03, 0.006), (0.8, 2.0))
    suspension = _controller(q, 1e-3, (0.3e-3, 0.06e-3), (6e-3, 30e-3))
    forced_1 = plant.lambda_1 * _response(q, plant.omega2_1, plant.delay_1 - HOLD / 2)
    forced_2 = plant.lambda_2 * _response(q, plant.omega2_2, plant.delay_2 - HOLD / 2)
    thrust_1 = _response(q, plant.omega2_1, THRUSTER_DELAY)
    thrust_2 = _response(q, plant.omega2_2, THRUSTER_DELAY)
    x_1 = _response(q, plant.omega2_1, 0) * at.g_1 + forced_1 * (at.f_1 + e_1)
    x_1 = (x_1 - thrust_1 * drag_free * (at.n_1 - at.guidance_1)) / (1 + thrust_1 * drag_free)
    thrust = drag_free * (x_1 + at.n_1 - at.guidance_1)
    error = at.n_12 - at.guidance_12 - (1 - plant.delta_ifo) * x_1  # but for x_2
    x_2 = _response(q, plant.omega2_2, 0) * (at.g_2 + e_12) - thrust_2 * thrust
    x_2 = (x_2 + forced_2 * (at.ahead + e_2 - suspension * error)) / (1 + forced_2 * suspension)
    return {
        "o_1": x_1 + at.n_1,
        "o_12": x_2 + error + at.guidance_12,
        "f_x_1": at.f_1,
        "f_x_2": at.ahead - suspension * (x_2 + error),
        "guidance_o_1": at.guidance_1,
        "guidance_o_12": at.guidance_12,
    }


def record(
    plant: Plant,
    noise: Noise,
    drive: Drive,
    duration: float,
    seed: list[int],
    *,
    fs: float = 1.0,
    hidden: Hidden | None = None,
) -> dict[str, Array]:
    """Return the channels of a run of `duration` [s], archived at 1 or 10 Hz.

    Parameters
    ----------
    seed : list of int
        Of the noise.
    hidden : callable, optional
        What acts and is not in the telemetry; found by iteration, so it should be a small part of the forces.
    """
    seconds = next_fast_len(int(duration + BEFORE + AFTER), real=True)
    n = int(seconds * fs)
    fine = np.arange(10 * seconds) * HOLD - BEFORE
    time = np.arange(n) / fs - BEFORE
    f = np.arange(n // 2 + 1) / seconds
    f[0] = 1e-3 * f[1]  # the loops hold a constant exactly
    q = np.exp(-2j * np.pi * f * HOLD)

    def amplitudes(values: Array) -> Array:
        if not values.any():
            return np.zeros(f.size, dtype=complex)
        return (np.fft.rfft(values) / values.size)[: f.size]

    draw = _Draw(f, seconds, seed)
    low = np.maximum(f, 1 / seconds)
    n_1, n_12, n_SC = draw(noise.oms), draw(noise.oms), draw(noise.thruster / SPACECRAFT)
    jitter = draw(noise.jitter * np.sqrt(1e-3 / low))
    each = np.hypot(noise.plateau, 60e-15 * noise.tail * 20e-6 / low) / np.sqrt(2)
    g_1, g_2 = draw(each), draw(each)
    g_2[0] += noise.balance
    ramp = amplitudes(_ramp(fine, drive.ramp, duration))
    inputs = _Inputs(
        guidance_1=amplitudes(_sines(fine, drive.guidance_1)),
        guidance_12=amplitudes(_sines(fine, drive.guidance_12)),
        f_1=jitter + ramp + amplitudes(_sines(fine, drive.force_1)),
        ahead=plant.lambda_1 / plant.lambda_2 * ramp,
        g_1=g_1 - n_SC,
        g_2=g_2 - n_SC,
        n_1=n_1,
        n_12=n_12,
    )
    flat = 1.0 if fs > 1 else np.cos(np.pi / 2 * np.clip((f - BAND[0]) / (BAND[1] - BAND[0]), 0, 1)) ** 2

    def series(e_1: Array | float, e_2: Array | float, e_12: Array | float) -> dict[str, Array]:
        found = _solve(plant, q, inputs, e_1, e_2, e_12)
        return {name: np.fft.irfft(amplitude * flat * n, n) for name, amplitude in found.items()}

    channels = series(0.0, 0.0, 0.0)
    for _ in range(3 if hidden else 0):
        channels = series(*map(amplitudes, hidden(time, channels)))
    keep = slice(int(BEFORE * fs), int((BEFORE + duration) * fs))
    return {name: values[keep].copy() for name, values in channels.items()}
