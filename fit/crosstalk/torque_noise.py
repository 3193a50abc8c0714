"""The Euler fit without its attenuation by noise of the torques, and with the errors of the calibration.

Two test masses measure the same rotation with noises of their own. Each is the instrument for the other: only
what both measure counts as rotation in the normal equations. Noise common to both does not show.
"""

from collections.abc import Sequence
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk.noise_share import noise_share
from fit.fitting import IRLSResult, prior_rows
from fit.whitening import whitened_run

Array = NDArray[np.float64]

ANGLES = 2  # delta_phi and delta_eta come before all other parameters
MAX_NOISE_FRACTION = 0.5  # of noise in some combination of the torques, from which nothing is corrected


class NoisyRotation(Protocol):
    """A whitened run of the Euler fit, whose columns of `inertial_forces.euler` are noisy."""

    def torque_noise(self, theta: Array) -> tuple[Array, Array]:
        """Return what noise of the torques adds to the normal equations.

        Parameters
        ----------
        theta : ndarray, shape (P,)
            The estimate.

        Returns
        -------
        noise, scatter : ndarray, shape (2, 2)
            The part of the normal equations that is noise, and the covariance of what it adds to their
            right-hand side.
        """

    def calibration_moments(self) -> Array:
        """Return products of the columns with what 1 sigma of the calibration adds to Delta g, (P, K)."""


def bias_corrected(outcome: IRLSResult, correlation: Array) -> tuple[Array, Array, bool]:
    """Return the angles without the attenuation by noise in dOmega.

    The mean m of two read-outs that disagree by 2 d has, but for noise common to both, the cross-power
    |m|^2 - |d|^2: that is what instruments of each for the other put in the place of |m|^2.

    Parameters
    ----------
    outcome : IRLSResult
        By least squares; its runs are `NoisyRotation`.
    correlation : ndarray, shape (K, K)
        Of the parameters of the calibration.

    Returns
    -------
    theta, covariance : ndarray, shapes (2,) and (2, 2)
        Of the angles, errors of the calibration and the scatter of the power of d included.
    is_noise : bool
        Whether most of dOmega is noise, in some combination of the angles; then nothing is corrected.
    """
    theta, covariance = outcome.solution.theta, outcome.solution.covariance
    width = np.array([p.prior_sigma for p in outcome.parameters])
    noise, scatter = np.zeros((2, width.size, width.size))
    for block in cast(Sequence[NoisyRotation], outcome.whitened_runs):
        of_run = block.torque_noise(theta)
        noise[:ANGLES, :ANGLES] += of_run[0]
        scatter[:ANGLES, :ANGLES] += of_run[1]
    H = _information(outcome)
    share = noise_share(H, noise, width, outcome.free)[0]
    is_noise = bool(share.max(initial=0.0) > MAX_NOISE_FRACTION)
    if not is_noise:
        inverse = whitened_run.scaled_inverse(H - noise, outcome.free)
        factor = np.eye(width.size) + inverse @ noise
        theta = factor @ theta
        covariance = factor @ covariance @ factor.T + inverse @ scatter @ inverse.T
    covariance = covariance + calibration_covariance(outcome, correlation)
    return theta[:ANGLES], covariance[:ANGLES, :ANGLES], is_noise


def _information(outcome: IRLSResult) -> Array:
    """Return the normal equations of least squares, priors included, shape (P, P)."""
    rows = prior_rows(outcome.result.params)[0]
    return whitened_run.information(outcome.whitened_runs, outcome.solution.theta) + rows.T @ rows


def calibration_covariance(outcome: IRLSResult, correlation: Array) -> Array:
    """Return the covariance that the errors of the calibration make, shape (P, P)."""
    inverse = whitened_run.scaled_inverse(_information(outcome), outcome.free)
    # One calibration serves all runs, so its errors add up; that of delta_ifo counts for nothing here.
    moments = [block.calibration_moments() for block in cast(Sequence[NoisyRotation], outcome.whitened_runs)]
    shift = inverse @ np.sum(moments, axis=0)
    return np.asarray(shift @ correlation @ shift.T)
