"""Frequency responses of the columns of a run to its channels, and where noise is asked for."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit.model import Delays, RunChannels, Spacecraft
from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

GRID = 40  # frequencies per decade at which cross-spectra are asked for; a spline leads from one to the next


def frequencies(run: Telemetry) -> Array:
    """Return the frequencies [Hz] at which cross-spectra are asked for of a run, shape (B,)."""
    lowest = 0.9 / run.duration
    n = int(GRID * np.log10(derivatives.F_MAX / lowest)) + 2
    return np.geomspace(lowest, 1.01 * derivatives.F_MAX, n)


def responses(
    spacecraft: Spacecraft, run: RunChannels, tau: Delays, names: Sequence[str], f: Array
) -> Spectrum:
    """Return the frequency responses of the K columns of a run to channels, shape (B, K, C).

    Parameters
    ----------
    spacecraft : Spacecraft
        Of the run.
    run : RunChannels
        At 1 to 2 Hz.
    tau : tuple of float
        The delays [s] about which the columns are expanded.
    names : sequence of str
        The C channels.
    f : ndarray, shape (B,)
        Hz.
    """
    still = np.zeros(4 * derivatives.HALF + 1)
    lags = np.arange(-derivatives.HALF, derivatives.HALF + 1) / run.fs
    time = np.arange(still.size) / run.fs
    pulse = still.copy()
    pulse[2 * derivatives.HALF] = 1.0

    def response(name: str) -> Array:
        driven = spacecraft.from_inputs(run, time, {**dict.fromkeys(names, still), name: pulse})
        return np.concatenate(list(spacecraft.column_groups(driven, tau)), axis=1)

    phases = np.exp(-2j * np.pi * f[:, None] * lags)
    return np.asarray(np.einsum("bm,cmk->bkc", phases, [response(name) for name in names]))
