"""Frequency responses of the columns of a run to its channels, and where noise is asked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.model import dynamics
from fit.spectra import derivatives
from fit.telemetry import Telemetry
from fit.whitening import Run

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

GRID = 40  # frequencies per decade at which cross-spectra are asked for; a spline leads from one to the next


def frequencies(run: Telemetry) -> Array:
    """Return the frequencies [Hz] at which cross-spectra are asked for of a run, shape (B,)."""
    lowest = 0.9 / run.duration
    n = int(GRID * np.log10(derivatives.F_MAX / lowest)) + 2
    return np.geomspace(lowest, 1.01 * derivatives.F_MAX, n)


def channels_of(run: Run) -> tuple[str, ...]:
    """Return the names of the channels that the columns of a run are made of."""
    of_means = (name for mean in run.channels.means for name in dynamics.MEANS[mean])
    return (*dynamics.CHANNELS, *of_means)


def responses(run: dynamics.Channels, tau: tuple[float, float], names: Sequence[str], f: Array) -> Spectrum:
    """Return the frequency responses of the K columns of a run to channels, shape (B, K, C).

    Parameters
    ----------
    run : Channels
        Of the run, at 1 to 2 Hz.
    tau : tuple of float
        The delays [s] about which the columns are expanded.
    names : sequence of str
        The C channels.
    f : ndarray, shape (B,)
        Hz.
    """

    def columns_of(time: Array, channels: Mapping[str, Array]) -> Array:
        means = {  # those of the run, also where they are still
            mean: np.sum([weight * channels[key] for key, weight in dynamics.MEANS[mean].items()], axis=0)
            for mean in run.means
        }
        read_outs = dict[str, Any]({name: channels[name] for name in dynamics.CHANNELS})
        valid = np.ones(time.size, dtype=bool)
        return dynamics.columns(replace(run, time=time, valid=valid, means=means, **read_outs), tau).values

    return impulse_responses(columns_of, run.fs, names, f)


def impulse_responses(
    columns_of: Callable[[Array, Mapping[str, Array]], Array], fs: float, names: Sequence[str], f: Array
) -> Spectrum:
    """Return the frequency responses of K columns to channels, from those to impulses, shape (B, K, C).

    Parameters
    ----------
    columns_of : callable
        From time [s], shape (N,), and channels by name, each of shape (N,), to the columns, shape
        (N - 2 HALF, K).
    fs : float
        Sample rate [Hz].
    names : sequence of str
        The C channels.
    f : ndarray, shape (B,)
        Hz.
    """
    still = np.zeros(4 * derivatives.HALF + 1)
    lags, time = np.arange(-derivatives.HALF, derivatives.HALF + 1) / fs, np.arange(still.size) / fs
    pulse = still.copy()
    pulse[2 * derivatives.HALF] = 1.0
    weights = [columns_of(time, {**dict.fromkeys(names, still), name: pulse}) for name in names]
    return np.asarray(np.einsum("bm,cmk->bkc", np.exp(-2j * np.pi * f[:, None] * lags), weights))
