"""Noise of the read-out o_1 beyond that of the noise run.

o_1 enters Delta g with a coefficient far below 1: its noise hardly shows in the residual, but attenuates
delta_ifo, as noise in a regressor does. Between injections it cannot be distinguished from motion. Where o_1
has more power there than in the noise run, only its injected signal is used: its spectrum between injections
becomes a nuisance column, which is projected out. That is right for motion, which only loses weight, and for
noise, which is small compared with an injection.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.spectra import Spectra, Spectrum

Array = NDArray[np.float64]

INJECTION_POWER = 10.0  # over that of the neighbours, which noise exceeds in 1 of 20,000 bins
N_MEDIAN = 201  # bins of the running median
N_FLANK, FLANK_POWER = 21, 2.0  # bins, and their mean over that of the neighbours: by chance once in 10^4
_MEDIAN_POWER = float(np.log(2))  # of exponentially distributed power of mean 1
O_1_COLUMNS = (dynamics.COLUMNS.index("ddo_1"), dynamics.COLUMNS.index("o_1"))


def running_mean(power: Array) -> Array:
    """Return the mean power of the neighbours of each bin, shape (B,), from a median: without injections."""
    return np.asarray(scipy.ndimage.median_filter(power, N_MEDIAN, mode="nearest") / _MEDIAN_POWER)


def without_injections(power: Array) -> NDArray[np.bool_]:
    """Return in which bins there is no injection, shape (B,), nor the flank of one that is switched."""
    mean = scipy.ndimage.uniform_filter1d(power, N_FLANK, mode="nearest")
    return np.asarray(mean < FLANK_POWER * running_mean(power))


def use_injections_only(spectra: Spectra, o_1: Spectrum | None = None) -> Spectra:
    """Return the spectra of a run with o_1 between injections as nuisance columns.

    Parameters
    ----------
    spectra : Spectra
        The run.
    o_1 : ndarray of complex, shape (B, 2), optional
        Spectra of `O_1_COLUMNS`; by default those of the run.
    """
    o_1 = spectra.columns[:, list(O_1_COLUMNS)] if o_1 is None else o_1
    power = np.abs(o_1[:, 0]) ** 2
    injected = power > INJECTION_POWER * running_mean(power)
    return replace(
        spectra, nuisance=np.concatenate([spectra.nuisance, np.where(injected[:, None], 0.0, o_1)], axis=1)
    )
