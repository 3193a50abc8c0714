"""The channels of a run at the rate of the loop, and what made it move: forces from motions, both ways."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import dynamics
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

RATE = 1 / dynamics.LOOP_PERIOD  # Hz
LOW = (0.1e-3, 0.2e-3)  # Hz: below, the loop lets so little thrust through that noise would pass for it
HIGH = (0.5, 1.0)  # Hz: above, nothing reaches the fitted band
BAND = (derivatives.F_MAX, 2 * derivatives.F_MAX)  # Hz: the end of that band
PASSED, STOPPED, RIPPLE = 0.2, 0.8, 120.0  # of the rate of an archive, that is filled up; dB
EDGE = 100.0  # s, over which what is imposed comes in and goes out
FORGOTTEN = 200.0  # s after a gap, when a controller but for its integrator is what it is without
BEGUN = (0.1, 1.0, 5.0, 20.0, 60.0)  # s since an answer: what is left of it then is all that a state does
NO_MODE = 1e-4  # relative strength below which there is none
MEMORY = 4096.0  # s, after which the loop has forgotten a push


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
    count, beta = scipy.signal.kaiserord(RIPPLE, 2 * (STOPPED - PASSED) / factor)
    taps = scipy.signal.firwin(count | 1, (STOPPED + PASSED) / factor, window=("kaiser", beta))
    found = scipy.signal.upfirdn(factor * taps, x - ends, up=factor)[taps.size // 2 :][: fine.size]
    return np.asarray(found + fine, dtype=np.float64)


@dataclass(frozen=True)
class Reduced:
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


def reduced(telemetry: Telemetry, of_fit: dynamics.Channels) -> Reduced:
    """Return the grid on which `force` puts a run, and what of it the fit's own channels leave."""
    taps, factor = derivatives.low_pass(RATE)
    size = (round(telemetry.size * RATE / telemetry.fs) - taps.size) // factor + 1
    instants = telemetry.time
    first = taps.size // 2 / RATE + instants[0]
    time = first + np.arange(size) * factor / RATE
    at = np.rint((time - of_fit.time[0]) * of_fit.fs).astype(int)
    inside = (at >= 0) & (at < of_fit.time.size)
    kept = np.where(inside, of_fit.valid[np.clip(at, 0, of_fit.time.size - 1)], True)
    half = slice(derivatives.HALF, -derivatives.HALF)
    steps = []
    missing = derivatives.interpolate_gaps(telemetry.channels["o_12"], telemetry.fs)[1]
    for begin, end in derivatives.true_runs(missing):
        kept &= (time < instants[begin]) | (time > instants[end - 1] + FORGOTTEN)
        steps.append((time > instants[end - 1]).astype(float)[half])
    found = np.stack(steps, axis=1) if steps else np.empty((size - 2 * derivatives.HALF, 0))
    return Reduced(RATE / factor, time[half], ~derivatives.dilate_mask(~kept), found)


def force(o_12: Array, f_x_2: Array, theta: Array) -> Array:
    """Return the force that made a change of o_12, shape (N,) [m]: the loop inverted (eq. deltagjointfit).

    Parameters
    ----------
    o_12, f_x_2 : ndarray, shape (N,)
        A change of the read-out at the rate of the loop, and what the controller answers.
    theta : ndarray, shape (7,)
        Of `dynamics.PARAMETERS`: the loop that is inverted.

    Returns
    -------
    ndarray
        On the grid of `reduced` [m s^-2]. A loop left to itself has none, whatever state it began in.
    """
    taps, factor = derivatives.low_pass(RATE)
    moved, pushed = (derivatives.decimate(x, taps, factor) for x in (o_12, f_x_2))
    none = np.zeros(moved.size)
    run = dynamics.Channels(
        RATE / factor, none, none, moved, none, pushed, {}, np.ones(none.size, dtype=bool), 0
    )
    return dynamics.total(dynamics.columns(run, dynamics.delays(theta)), theta)


def blow(size: int, unit: float) -> Array:
    """Return a stray thrust of a single sample, `unit` [N], for a run of `size` samples or less."""
    n = min(round(MEMORY * RATE), size)
    return np.where(np.arange(n) == min(round(EDGE * RATE), n // 2), unit, 0.0)


def thrust(motion: Array, blown: Array, made: Array) -> Array:
    """Return the stray thrust [N], shape (N,), that moves test mass 1 like this, in mid-band.

    Parameters
    ----------
    motion : ndarray, shape (N,)
        Of o_1 [m].
    blown, made : ndarray, shape (M,)
        A stray thrust, and what o_1 makes of it.
    """
    return _answer(motion, made, blown, RATE, HIGH)


def settling(answer: Array, size: int) -> Array:
    """Return what the state that a controller began in adds to the force, shape (N, number of its modes).

    Its integrator left out, whose constant no residual has anyway.

    Parameters
    ----------
    answer : ndarray, shape (M,)
        Of the controller, to a motion in the first sample and in no other.
    size : int
        Number of samples of the run at the rate of the loop.
    """
    taps, factor = derivatives.low_pass(RATE)
    later = np.pad(answer - answer[-1], (0, size), mode="edge")
    half = slice(derivatives.HALF, -derivatives.HALF)
    columns = [derivatives.decimate(later[round(s * RATE) :][:size], taps, factor)[half] for s in BEGUN]
    modes, strength, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    return np.asarray(modes[:, strength > NO_MODE * strength[0]])


def followed(motion: Array, made: Array, force_made: Array) -> Array:
    """Return the force that a motion of o_1 goes along with where a stray thrust makes it, in mid-band.

    Parameters
    ----------
    motion : ndarray, shape (N,)
        Of o_1 at the rate of the loop [m].
    made : ndarray, shape (M,)
        The same after a single blow.
    force_made : ndarray
        What `force` makes of that.

    Returns
    -------
    ndarray
        On the grid of `reduced` [m s^-2].
    """
    taps, factor = derivatives.low_pass(RATE)
    half = slice(derivatives.HALF, -derivatives.HALF)
    moved, answer = (derivatives.decimate(x, taps, factor)[half] for x in (motion, made))
    return _answer(moved, answer, force_made, RATE / factor, BAND)


def _answer(x: Array, cause: Array, effect: Array, fs: float, high: tuple[float, float]) -> Array:
    """Return what x, shape (N,), has for an effect, as `cause` has `effect`; from LOW to `high`."""
    size = scipy.fft.next_fast_len(x.size + cause.size, real=True)
    f = scipy.fft.rfftfreq(size, 1 / fs)
    passed = _rise(f, *LOW) * (1 - _rise(f, *high))
    found = scipy.fft.rfft(x * _flanks(x.size, fs), size)  # in place from here on: a run may last for days
    found *= scipy.fft.rfft(effect, size)
    found *= passed
    np.divide(found, scipy.fft.rfft(cause, size), out=found, where=passed > 0)
    return np.asarray(scipy.fft.irfft(found, size)[: x.size], dtype=np.float64)


def _rise(f: Array, low: float, high: float) -> Array:
    return np.asarray(np.sin(np.pi / 2 * np.clip((f - low) / (high - low), 0, 1)) ** 2)


def _flanks(n: int, fs: float) -> Array:
    rise = np.minimum(np.arange(n) + 1, np.arange(n)[::-1] + 1) / (EDGE * fs)
    return np.asarray(np.sin(np.pi / 2 * np.minimum(rise, 1)) ** 2)
