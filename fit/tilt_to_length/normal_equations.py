"""Estimates of the coefficients: least squares, and instruments that noise of wavefront sensing cannot bias.

Wavefront sensing reads theta + n. With its noise n in the columns, least squares attenuates: the normal
matrix holds the power of n, the right-hand side does not (Hartig et al. 2024, arXiv:2410.16475). The
instruments have no part in that: n is white in the angle, the motion is not. With G(f) the share of motion in
the power of an angle, P its two columns (reception and emission) and P_n the response to white noise in it,

    Z = G P - P Gamma,    sum_f P_n^H W (G P_n - P_n Gamma) = 0

determines the 2 x 2 matrix Gamma, whatever the level of the noise. Estimates by
these instruments are consistent; where the motion is as white as the noise, Z vanishes and with it all that
the data say.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.spectra import fit_noise
from fit.tilt_to_length.coefficients import NAMES, SERIES
from fit.tilt_to_length.response import ResponseSpectra

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

_N_PATHS = len(NAMES) // len(SERIES)


@dataclass(frozen=True)
class LinearEstimate:
    """Coefficients with the inverse of their covariance.

    Attributes
    ----------
    c : ndarray, shape (24,)
        Coefficients [m/rad]; those of directions without information are arbitrary.
    information : ndarray, shape (24, 24)
        Inverse of their covariance, window included.
    bias : ndarray, shape (24,)
        What the noise of wavefront sensing makes of them on average, estimated [m/rad].
    """

    c: Array
    information: Array
    bias: Array


def product(left: Spectrum, weights: Array, right: Spectrum) -> Array:
    """Return ``2 Re sum left^H W right`` over bins and variables.

    Parameters
    ----------
    left, right : ndarray of complex, shape (3, B, K) and (3, B, L)
        Columns.
    weights : ndarray, shape (3, B)
        Inverse of the PSDs.
    """
    flat = (left * weights[..., None]).reshape(-1, left.shape[-1])
    return np.asarray(2 * (flat.conj().T @ right.reshape(-1, right.shape[-1])).real)


def noise_product(spectra: ResponseSpectra, weights: Array, share: Array | None = None) -> Array:
    """Return `product` of the response to white noise of 1 rad Hz^-0.5 in every angle, shape (24, 24).

    Noises of different angles are independent; `share`, shape (12, B), weighs the bins of each.
    """
    total = np.zeros((len(NAMES), len(NAMES)))
    for i in range(len(SERIES)):
        pair = slice(_N_PATHS * i, _N_PATHS * (i + 1))
        response = spectra.transfer[..., pair]
        weighed = weights if share is None else weights * share[i]
        total[pair, pair] = product(response, weighed, response)
    return total


def least_squares(spectra: ResponseSpectra, weights: Array, dws_asd: float) -> LinearEstimate:
    """Return the estimate of least squares, with the bias by noise of `dws_asd` [rad Hz^-0.5]."""
    normal = product(spectra.columns, weights, spectra.columns)
    c = _solve(normal, product(spectra.columns, weights, spectra.data[..., None])[:, 0])
    bias = -_solve(normal, dws_asd**2 * noise_product(spectra, weights) @ c)
    return LinearEstimate(c, normal / spectra.variance_factor, bias)


def instrumental_variables(spectra: ResponseSpectra, weights: Array) -> LinearEstimate:
    """Return the estimate by instruments."""
    share = motion_share(spectra)
    noise, weighed = noise_product(spectra, weights), noise_product(spectra, weights, share)
    gamma = _solve(noise, weighed)
    instruments = np.repeat(share, _N_PATHS, axis=0).T * spectra.columns - spectra.columns @ gamma
    slope = product(instruments, weights, spectra.columns)
    scores = product(instruments, weights, spectra.data[..., None])[:, 0]
    scatter = product(instruments, weights, instruments) * spectra.variance_factor
    information = slope.T @ _solve(scatter, slope)
    return LinearEstimate(_solve(slope, scores), (information + information.T) / 2, np.zeros(len(NAMES)))


def motion_share(spectra: ResponseSpectra) -> Array:
    """Return the share of motion in the power of every angle, shape (12, B), above its least smooth PSD."""
    shares = []
    for angle in spectra.angles:
        power = np.abs(angle) ** 2
        smooth = fit_noise(spectra.f, power, np.ones(power.size)).leave_one_out(spectra.f, power)
        shares.append(1 - smooth.min() / smooth)
    return np.array(shares)


def _solve(matrix: Array, right: Array) -> Array:
    """Return the solution of a system of columns of any scale; the least one where it is singular."""
    scale = 1 / np.sqrt(np.maximum(np.abs(np.diag(matrix)), np.finfo(float).tiny))
    scaled = scale[:, None] * matrix * scale
    solution = np.linalg.lstsq(scaled, (scale * right.T).T, rcond=1e-12)[0]
    return np.asarray((scale * solution.T).T)
