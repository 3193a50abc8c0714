"""Estimates of the coefficients: least squares, and instruments for noise of an unknown level.

Wavefront sensing reads theta + n. With its noise n in the columns, least squares attenuates: the normal
matrix holds the power of n, the right-hand side does not (Hartig et al. 2024, arXiv:2410.16475). Where its
level is known, that power is subtracted. Instruments need not know it: n is white in the angle, the motion is
not. With G(f) the share of motion in
the power of an angle, P its two columns (reception and emission) and P_n the response to white noise in it,

    Z = G P - P Gamma,    sum_f P_n^H W (G P_n - P_n Gamma) = 0

determines the 2 x 2 matrix Gamma, whatever the level of the noise. Estimates by
these instruments are consistent; where the motion is as white as the noise, Z vanishes and with it all that
the data say.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import null_space
from fit.spectra import fit_noise
from fit.tilt_to_length.coefficients import N_PATHS, NAMES, SERIES, WIDTH
from fit.tilt_to_length.response import ResponseSpectra

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

LEAST_EXCESS = 5.0


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
        What the noise of wavefront sensing adds to least squares on average, subtracted [m/rad].
    """

    c: Array
    information: Array
    bias: Array

    @property
    def sigma(self) -> Array:
        """Standard deviations [m/rad], shape (24,), infinite where a coefficient is not determined."""
        undetermined, _ = null_space.null_space(self.information, np.full(len(NAMES), WIDTH))
        return np.where(undetermined, np.inf, np.sqrt(np.diag(scipy.linalg.pinvh(self.information))))

    def with_uncertain_bias(self) -> "LinearEstimate":
        """Return the same for a bias whose standard deviation is as large as itself."""
        scores = self.information @ self.bias
        information = self.information - np.outer(scores, scores) / (1 + self.bias @ scores)
        return replace(self, information=information)


def product(left: Spectrum, weights: Array, right: Spectrum) -> Array:
    """Return ``2 Re sum left^H W right`` over bins and variables.

    Parameters
    ----------
    left, right : ndarray of complex, shape (V, B, K) and (V, B, L)
        Columns.
    weights : ndarray, shape (V, B)
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
        pair = slice(N_PATHS * i, N_PATHS * (i + 1))
        response = spectra.transfer[..., pair]
        weighed = weights if share is None else weights * share[i]
        total[pair, pair] = product(response, weighed, response)
    return total


def least_squares(spectra: ResponseSpectra, weights: Array, dws_asd: float) -> LinearEstimate:
    """Return the estimate of least squares less its bias by noise of wavefront sensing.

    With N the normal matrix and S what noise of `dws_asd` [rad Hz^-0.5] adds to it on average, it solves
    ``(N - S) c = X^T W data``. Directions in which N exceeds S by less than `LEAST_EXCESS` times the scatter
    of S have no information.
    """
    normal = product(spectra.columns, weights, spectra.columns)
    score = product(spectra.columns, weights, spectra.data[..., None])[:, 0]
    values, vectors = np.linalg.eigh(normal * WIDTH**2)
    informed = values > max(null_space.FLOOR, 1e-13 * float(values[-1]))
    root = np.sqrt(values[informed])
    basis = WIDTH * vectors[:, informed] / root
    noise = dws_asd**2 * noise_product(spectra, weights)
    motion, turn = np.linalg.eigh(np.eye(root.size) - basis.T @ noise @ basis)
    basis = basis @ turn  # basis.T @ normal @ basis = 1, of which `motion` is that of the motion
    is_excited = motion > LEAST_EXCESS * dws_asd**2 * _noise_scatter(spectra, weights, basis)
    c = basis[:, is_excited] @ (score @ basis[:, is_excited] / motion[is_excited])
    uncorrected = basis[:, is_excited] @ (score @ basis[:, is_excited])
    rows = motion[is_excited, None] * (normal @ basis[:, is_excited]).T
    return LinearEstimate(c, rows.T @ rows / spectra.variance_factor, uncorrected - c)


def _noise_scatter(spectra: ResponseSpectra, weights: Array, basis: Array) -> Array:
    """Return the scatter of the power that noise of 1 rad Hz^-0.5 has in combinations, shape (K,).

    `basis`, shape (24, K), has the combinations.
    """
    variance = np.zeros(basis.shape[1])
    for i in range(len(SERIES)):
        pair = slice(N_PATHS * i, N_PATHS * (i + 1))
        power = 2 * np.einsum("vb,vbk->bk", weights, np.abs(spectra.transfer[..., pair] @ basis[pair]) ** 2)
        variance += np.sum(power**2, axis=0)
    return np.asarray(np.sqrt(spectra.variance_factor * variance))


def instrumental_variables(spectra: ResponseSpectra, weights: Array) -> LinearEstimate:
    """Return the estimate by instruments."""
    share = motion_share(spectra)
    noise, weighed = noise_product(spectra, weights), noise_product(spectra, weights, share)
    gamma = _solve(noise, weighed)
    instruments = np.repeat(share, N_PATHS, axis=0).T * spectra.columns - spectra.columns @ gamma
    slope = product(instruments, weights, spectra.columns)
    scores = product(instruments, weights, spectra.data[..., None])[:, 0]
    scatter = product(instruments, weights, instruments) * spectra.variance_factor
    information = slope.T @ _solve(scatter, slope)
    return LinearEstimate(_solve(slope, scores), (information + information.T) / 2, np.zeros(len(NAMES)))


def motion_share(spectra: ResponseSpectra) -> Array:
    """Return the share of motion in the power of every angle, shape (12, B), above its least smooth PSD."""
    shares = np.zeros(spectra.angles.shape)
    for i in np.flatnonzero(spectra.angles.any(axis=1)):
        power = np.abs(spectra.angles[i]) ** 2
        smooth = fit_noise(spectra.f, power, np.ones(power.size)).leave_one_out(spectra.f, power)
        shares[i] = 1 - smooth.min() / smooth
    return shares


def _solve(matrix: Array, right: Array) -> Array:
    """Return the solution of a system of columns of any scale; the least one where it is singular."""
    scale = 1 / np.sqrt(np.maximum(np.abs(np.diag(matrix)), np.finfo(float).tiny))
    scaled = scale[:, None] * matrix * scale
    solution = np.linalg.lstsq(scaled, (scale * right.T).T, rcond=1e-12)[0]
    return np.asarray((scale * solution.T).T)
