"""The channels of a run at the rate of the loop, forces from motions, and motions from forces."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import RunChannels, dynamics
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

RATE = 1 / dynamics.LOOP_PERIOD  # Hz
LOW_EDGE = (0.1e-3, 0.2e-3)  # Hz: below, the loop lets so little thrust through that noise would pass for it
HIGH_EDGE = (0.5, 1.0)  # Hz: above, nothing reaches the fitted band
BAND = (derivatives.F_MAX, 2 * derivatives.F_MAX)  # Hz: the end of that band
PASSBAND, STOPBAND, RIPPLE = 0.2, 0.8, 120.0  # of the rate of an archive, that is filled up; dB
TAPER = 100.0  # s, over which what is imposed comes in and goes out
GAP_MEMORY = 200.0  # s after a gap, when a controller but for its integrator is what it is without
#: s after a response, at which the remaining transient is that of the state.
TRANSIENT_TIMES = (0.1, 1.0, 5.0, 20.0, 60.0)
SINGULAR_MODE = 1e-4  # relative strength below which there is none
IMPULSE_DURATION = 4096.0  # s, after which the loop has forgotten a push


def at_loop_rate(telemetry: Telemetry, channel: str) -> Array:
    """Return a channel at the rate of the loop, shape (N,); gaps are bridged.

    Raises
    ------
    InputError
        If the rate of the run does not divide that of the loop.
    """
    factor = round(RATE / telemetry.fs)
    if abs(factor * telemetry.fs - RATE) > 1e-6 * RATE:
        raise InputError(
            f"{telemetry.path}: sampled at {telemetry.fs:g} Hz, expected a rate that divides {RATE:g} Hz"
        )
    x = derivatives.interpolate_gaps(telemetry.channels[channel], telemetry.fs)[0]
    if factor == 1:
        return x
    ends = np.linspace(x[0], x[-1], x.size)  # what is resampled begins and ends at zero
    fine = np.interp(np.arange(x.size * factor) / factor, np.arange(x.size), ends)
    count, beta = scipy.signal.kaiserord(RIPPLE, 2 * (STOPBAND - PASSBAND) / factor)
    taps = scipy.signal.firwin(count | 1, (STOPBAND + PASSBAND) / factor, window=("kaiser", beta))
    resampled = scipy.signal.upfirdn(factor * taps, x - ends, up=factor)[taps.size // 2 :][: fine.size]
    return np.asarray(resampled + fine, dtype=np.float64)


@dataclass(frozen=True)
class ReducedGrid:
    """What is left of a run after the low-pass and the stencils.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    valid : ndarray of bool, shape (N,)
        False where something is masked, or where a controller has not forgotten a gap.
    steps : ndarray, shape (N, number of gaps)
        For every gap in o_12, a step at its end: what the integrator of the controller missed.
    """

    fs: float
    time: Array
    valid: NDArray[np.bool_]
    steps: Array


def reduced_grid(telemetry: Telemetry, fit_channels: RunChannels) -> ReducedGrid:
    """Return the grid on which `force` puts a run, and what of it the fit's own channels leave."""
    taps, factor = derivatives.low_pass(RATE)
    size = (round(telemetry.size * RATE / telemetry.fs) - taps.size) // factor + 1
    instants = telemetry.time
    start = taps.size // 2 / RATE + instants[0]
    time = start + np.arange(size) * factor / RATE
    indices = np.rint((time - fit_channels.time[0]) * fit_channels.fs).astype(int)
    is_inside = (indices >= 0) & (indices < fit_channels.time.size)
    valid = np.where(is_inside, fit_channels.valid[np.clip(indices, 0, fit_channels.time.size - 1)], True)
    half = slice(derivatives.HALF, -derivatives.HALF)
    steps = []
    missing = derivatives.interpolate_gaps(telemetry.channels["o_12"], telemetry.fs)[1]
    for begin, end in derivatives.true_runs(missing):
        valid &= (time < instants[begin]) | (time > instants[end - 1] + GAP_MEMORY)
        steps.append((time > instants[end - 1]).astype(float)[half])
    step_columns = np.stack(steps, axis=1) if steps else np.empty((size - 2 * derivatives.HALF, 0))
    return ReducedGrid(RATE / factor, time[half], ~derivatives.dilate_mask(~valid), step_columns)


def force(o_12: Array, f_x_2: Array, theta: Array) -> Array:
    """Return the force that made a change of o_12, shape (N,) [m]: the loop inverted (Eq. (11)).

    Parameters
    ----------
    o_12, f_x_2 : ndarray, shape (N,)
        A change of the read-out at the rate of the loop, and what the controller answers.
    theta : ndarray, shape (7,)
        Of `dynamics.PARAMETERS`: the loop that is inverted.

    Returns
    -------
    ndarray
        On the grid of `reduced_grid` [m s^-2]. A loop left to itself has none, whatever state it began in.
    """
    taps, factor = derivatives.low_pass(RATE)
    motion_series, command_series = (derivatives.decimate(x, taps, factor) for x in (o_12, f_x_2))
    zeros = np.zeros(motion_series.size)
    run = RunChannels(
        fs=RATE / factor,
        time=zeros,
        valid=np.ones(zeros.size, dtype=bool),
        missing=0,
        series={"o_1": zeros, "o_12": motion_series, "f_x_1": zeros, "f_x_2": command_series},
        parameters=dynamics.PARAMETERS,
    )
    return dynamics.total(dynamics.columns(run, dynamics.delays(theta)), theta)


def impulse(size: int, unit: float) -> Array:
    """Return a stray thrust of a single sample, `unit` [N], for a run of `size` samples or less."""
    n = min(round(IMPULSE_DURATION * RATE), size)
    return np.where(np.arange(n) == min(round(TAPER * RATE), n // 2), unit, 0.0)


def stray_thrust(motion: Array, impulse: Array, motion_response: Array) -> Array:
    """Return the stray thrust [N], shape (N,), that moves test mass 1 like this, in mid-band.

    Parameters
    ----------
    motion : ndarray, shape (N,)
        Of o_1 [m].
    impulse, motion_response : ndarray, shape (M,)
        A stray thrust, and the response of o_1.
    """
    return _transfer(motion, motion_response, impulse, RATE, HIGH_EDGE)


def initial_transient(controller_response: Array, size: int) -> Array:
    """Return what the state that a controller began in adds to the force, shape (N, number of its modes).

    Its integrator left out, whose constant no residual has anyway.

    Parameters
    ----------
    controller_response : ndarray, shape (M,)
        Of the controller, to a motion in the first sample and in no other.
    size : int
        Number of samples of the run at the rate of the loop.
    """
    taps, factor = derivatives.low_pass(RATE)
    extended = np.pad(controller_response - controller_response[-1], (0, size), mode="edge")
    half = slice(derivatives.HALF, -derivatives.HALF)
    columns = [
        derivatives.decimate(extended[round(s * RATE) :][:size], taps, factor)[half] for s in TRANSIENT_TIMES
    ]
    modes, strength, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    return np.asarray(modes[:, strength > SINGULAR_MODE * strength[0]])


def response_force(motion: Array, motion_response: Array, force_response: Array) -> Array:
    """Return the force that a motion of o_1 goes along with where a stray thrust makes it, in mid-band.

    Parameters
    ----------
    motion : ndarray, shape (N,)
        Of o_1 at the rate of the loop [m].
    motion_response : ndarray, shape (M,)
        The same after a single blow.
    force_response : ndarray
        The result of `force` for it.

    Returns
    -------
    ndarray
        On the grid of `reduced_grid` [m s^-2].
    """
    taps, factor = derivatives.low_pass(RATE)
    half = slice(derivatives.HALF, -derivatives.HALF)
    motion_series, controller_response = (
        derivatives.decimate(x, taps, factor)[half] for x in (motion, motion_response)
    )
    return _transfer(motion_series, controller_response, force_response, RATE / factor, BAND)


def _transfer(x: Array, cause: Array, effect: Array, fs: float, high: tuple[float, float]) -> Array:
    """Return what x, shape (N,), has for an effect, as `cause` has `effect`; from LOW to `high`."""
    size = scipy.fft.next_fast_len(x.size + cause.size, real=True)
    f = scipy.fft.rfftfreq(size, 1 / fs)
    passband = _rise(f, *LOW_EDGE) * (1 - _rise(f, *high))
    spectrum = scipy.fft.rfft(x * _flanks(x.size, fs), size)  # in place from here on: a run may last for days
    spectrum *= scipy.fft.rfft(effect, size)
    spectrum *= passband
    np.divide(spectrum, scipy.fft.rfft(cause, size), out=spectrum, where=passband > 0)
    return np.asarray(scipy.fft.irfft(spectrum, size)[: x.size], dtype=np.float64)


def _rise(f: Array, low: float, high: float) -> Array:
    return np.asarray(np.sin(np.pi / 2 * np.clip((f - low) / (high - low), 0, 1)) ** 2)


def _flanks(n: int, fs: float) -> Array:
    rise = np.minimum(np.arange(n) + 1, np.arange(n)[::-1] + 1) / (TAPER * fs)
    return np.asarray(np.sin(np.pi / 2 * np.minimum(rise, 1)) ** 2)
