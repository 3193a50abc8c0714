"""What a manoeuvre is expected to determine: Fisher information of X2, Y2, Z2 on the coefficients."""

import numpy as np

from fit.tilt_to_length import michelson
from fit.tilt_to_length.coefficients import NAMES
from fit.tilt_to_length.measurements import CENTRAL_FREQUENCY, Measurements
from fit.tilt_to_length.normal_equations import LinearEstimate, product
from fit.tilt_to_length.response import response_spectra

#: m Hz^-0.5, noise of every link after TDI: that of lisainstrument 2.3 from 8 mHz to 0.2 Hz, to 15 %.
LINK_ASD = 7.8e-12
#: One-sided PSD of A, E and T [cycles^2/Hz] divided by the square of `noise_shape`, for independent links.
NOISE_PSD = 2 * (LINK_ASD * CENTRAL_FREQUENCY / michelson.C) ** 2


def expected_sigmas(measurements: Measurements) -> dict[str, float]:
    """Return the sigmas of the coefficients that wavefront sensing without noise would give.

    Parameters
    ----------
    measurements : Measurements
        The motion; its Michelson variables are not used.

    Returns
    -------
    dict of str to float
        By coefficient, window included [m/rad]; infinite where it is not determined.
    """
    spectra = response_spectra(measurements)
    weights = np.full(spectra.data.shape, 1 / NOISE_PSD)
    information = product(spectra.columns, weights, spectra.columns) / spectra.variance_factor
    none = np.zeros(len(NAMES))
    return dict(zip(NAMES, LinearEstimate(none, information, none).sigma.tolist(), strict=True))
