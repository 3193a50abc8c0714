"""The channels of a run that an equation of motion needs, low-passed and decimated alike."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fit.spectra import derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RunChannels:
    """The channels of one run that its equations need, low-passed and decimated alike.

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
    series : mapping of str to ndarray, each of shape (N,)
        Read-outs [m], commanded forces per unit mass [m s^-2], angles [rad].
    parameters : tuple of str
        Names of the P parameters that the run can be fitted for.
    means : mapping of str to ndarray, each of shape (N,)
        Means over the test masses of their motion and torques, where the run has them [m], [rad] or [N m].
    """

    fs: float
    time: Array
    valid: NDArray[np.bool_]
    missing: int
    series: Mapping[str, Array]
    parameters: tuple[str, ...] = ()
    means: Mapping[str, Array] = field(default_factory=dict)


def reduce_channels(
    telemetry: Telemetry, channels: Iterable[tuple[str, Array]], taps: Array, factor: int
) -> RunChannels:
    """Low-pass and decimate channels, each of shape (M,), one by one: as archived, they fill the memory."""
    series: dict[str, Array] = {}
    touched = absent = np.zeros(1, dtype=bool)
    for name, raw in channels:
        series[name], masked, missing = derivatives.preprocess(raw, telemetry.fs, taps, factor)
        touched, absent = touched | masked, absent | missing
    time = telemetry.time[taps.size // 2 :: factor][: touched.size]
    return RunChannels(telemetry.fs / factor, time, ~touched, int(np.count_nonzero(absent)), series)
