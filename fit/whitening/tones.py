"""Runs whose signal is one tone, or none: what they cannot tell whatever their noise seems to say."""

import numpy as np
from numpy.typing import NDArray

from fit.model import dynamics
from fit.parameters import FLIGHT
from fit.spectra import Spectrum

Array = NDArray[np.float64]

SIGNAL = 100.0  # whitened power in one bin (noise: 2) from which it is no noise
STRAY = 0.02  # share of the signal that switching a tone on and off scatters over other frequencies
_DRIVES = [dynamics.COLUMNS.index(name) for name in ("ddo_12", "o_12")]
_DRIVE_SCALES = np.array([1.0, FLIGHT["omega2_2_0"].value])


def drives(columns: Spectrum | Array) -> Array:
    """Return the power in whitened columns of what tells gains and of what tells stiffness, shape (..., 2).

    The one is ``o_12''``, which stands for all forces, the other ``o_12`` times the stiffness of flight.
    """
    return np.asarray(np.abs(columns[..., _DRIVES]) ** 2 * _DRIVE_SCALES**2)


def single_tone(f: Array, power: Array) -> float | None:
    """Return the frequency of a signal that lies within half an octave nearly whole, 0 without a signal.

    Such a run cannot tell a gain from a stiffness (and without a signal, none of them at all), whatever the
    noise seems to say: where the commands only answer to the noise, a fit leans on the model of that noise
    more than it can bear. A force at one frequency and a motion at another tell both.

    Parameters
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz].
    power : ndarray, shape (B, 2)
        Whitened power as that of `drives`, 2 where there is but noise.
    """
    signal = np.where(power > SIGNAL, power, 0.0)
    if not signal.any():
        return 0.0
    peak = float(f[np.argmax(signal[:, 0] if signal[:, 0].any() else signal[:, 1])])
    apart = np.abs(np.log2(f / peak)) > 0.5
    if signal[:, 1].any() and apart[np.argmax(signal[:, 1])]:
        return None
    return peak if signal[apart, 0].sum() < STRAY * signal[:, 0].sum() else None
