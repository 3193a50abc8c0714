"""The channels of a run that an equation of motion needs, low-passed and decimated alike."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RunChannels:
    """The time axis of the channels of one run.

    Attributes
    ----------
    fs : float
        Sample rate [Hz], 1 to 2 Hz for anything archived faster.
    time : ndarray, shape (N,)
        Seconds since the start of the run.
    valid : ndarray of bool, shape (N,)
        False where missing samples reach.
    missing : int
        Number of missing samples in the file.
    """

    fs: float
    time: Array
    valid: NDArray[np.bool_]
    missing: int


def reduce_channels(
    telemetry: Telemetry, channels: Iterable[tuple[str, Array]], taps: Array, factor: int
) -> tuple[RunChannels, dict[str, Array]]:
    """Low-pass and decimate channels, each of shape (M,), one by one: as archived, they fill the memory.

    Returns
    -------
    RunChannels
        Their common time axis.
    series : dict of str to ndarray, each of shape (N,)
        By name.
    """
    series: dict[str, Array] = {}
    touched = absent = np.zeros(1, dtype=bool)
    for name, raw in channels:
        series[name], masked, missing = derivatives.preprocess(raw, telemetry.fs, taps, factor)
        touched, absent = touched | masked, absent | missing
    time = telemetry.time[taps.size // 2 :: factor][: touched.size]
    return RunChannels(telemetry.fs / factor, time, ~touched, int(np.count_nonzero(absent))), series
