"""What a manoeuvre is expected to determine: Fisher information of X2, Y2, Z2 on the coefficients."""

import numpy as np
from numpy.typing import NDArray

from fit.tilt_to_length import michelson
from fit.tilt_to_length.coefficients import NAMES
from fit.tilt_to_length.measurements import CENTRAL_FREQUENCY, Measurements
from fit.tilt_to_length.normal_equations import product
from fit.tilt_to_length.response import response_spectra

Array = NDArray[np.float64]

#: m Hz^-0.5, noise of every link after TDI: that of lisainstrument 2.3 from 8 mHz to 0.2 Hz, to 15 %.
LINK_ASD = 7.8e-12
#: One-sided PSD of A, E and T [cycles^2/Hz] divided by the square of `noise_shape`, for independent links.
NOISE_PSD = 2 * (LINK_ASD * CENTRAL_FREQUENCY / michelson.C) ** 2


def expected_covariance(measurements: Measurements) -> Array:
    """Return the covariance of the coefficients that wavefront sensing without noise would give.

    Parameters
    ----------
    measurements : Measurements
        The motion; its Michelson variables are not used.

    Returns
    -------
    ndarray, shape (24, 24)
        Window included [m^2/rad^2]; infinite if a combination is not determined.
    """
    spectra = response_spectra(measurements)
    weights = np.full(spectra.data.shape, 1 / NOISE_PSD)
    information = product(spectra.columns, weights, spectra.columns) / spectra.variance_factor
    return _inverse(information)


def _inverse(information: Array) -> Array:
    """Return the inverse of a matrix of any scale; infinite where it is singular."""
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    scaled = information / np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e10:
        return np.full((len(NAMES), len(NAMES)), np.inf)
    return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))
