"""Channels at the rate of the loop, and forces told from motions."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy

from fit.identification import series
from fit.spectra import derivatives


def archive(fs, x):
    return SimpleNamespace(fs=fs, channels={"x": x}, path="run.h5")


@pytest.mark.parametrize("fs", [1.0, 2.0, 5.0])
@pytest.mark.parametrize("f", [1e-3, 0.05, 0.1])
def test_an_archive_is_filled_up_in_the_fitted_band(fs, f):
    time = np.arange(3000 * fs) / fs
    resampled = series.at_loop_rate(archive(fs, np.sin(2 * np.pi * f * time) + 1e-3 * time), "x")
    fine = np.arange(resampled.size) / series.RATE
    inside = (fine > 300) & (fine < 2700)
    assert resampled.size == 3000 * series.RATE
    assert np.max(np.abs(resampled - np.sin(2 * np.pi * f * fine) - 1e-3 * fine)[inside]) < 5e-6


def test_the_thrust_that_moved_a_loop_is_found():
    decay = scipy.signal.butter(1, [5e-4, 0.05], "bandpass", fs=series.RATE, output="sos")

    def push(stray_thrust):
        return scipy.signal.sosfilt(decay, stray_thrust)

    n = 60000
    stray_thrust = np.sin(2 * np.pi * 0.02 * np.arange(n) / series.RATE)
    impulse = series.impulse(n, 1.0)
    thrust = series.stray_thrust(push(stray_thrust), impulse, push(impulse))
    inside = slice(20000, -5000)
    assert np.max(np.abs(thrust - stray_thrust)[inside]) < 1e-2


def test_the_force_of_a_motion():
    decay = scipy.signal.butter(1, [5e-4, 0.05], "bandpass", fs=series.RATE, output="sos")
    taps, factor = derivatives.low_pass(series.RATE)

    def force(x):  # some force that the same thrust makes, on the grid of forces
        lower = scipy.signal.butter(1, 5e-3, fs=series.RATE, output="sos")
        return derivatives.decimate(scipy.signal.sosfilt(lower, x), taps, factor)[10:-10]

    n = 60000
    stray_thrust = np.sin(2 * np.pi * 0.02 * np.arange(n) / series.RATE)
    impulse = series.impulse(n, 1.0)
    motion, response = (scipy.signal.sosfilt(decay, x) for x in (stray_thrust, impulse))
    result = series.response_force(motion, response, force(impulse))
    inside = slice(2000, -500)
    assert result.shape == force(stray_thrust).shape
    assert np.max(np.abs(result - force(stray_thrust))[inside]) < 1e-2 * np.max(np.abs(force(stray_thrust)))
