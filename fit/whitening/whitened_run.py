"""Weighted least squares on compressed runs: whitening, true sigmas.

Whitened by a smooth PSD, a windowed run is 2 B real numbers per column. Its QR factor holds all of chi^2 in
a triangle of one row per column, so that a joint minimisation costs milliseconds however long the runs are.

The fitted band starts at the first bin. In closed loop the commands answer to the noise; the least-squares
conditions stay free of bias because that answer is causal, so that its transfer sums to zero over the *whole*
band. Leaving out the lowest bins would break the sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from fit.errors import FitError
from fit.model import Equation, dynamics
from fit.spacecraft import DELTA_G
from fit.spectra import NoiseModel, Spectra, Spectrum, windowing
from fit.telemetry import pieces
from fit.whitening.likelihoods import Likelihood, Weights, weights

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WhitenedRun:
    """One whitened run.

    Attributes
    ----------
    tau : tuple of float
        The delays [s] about which its columns are expanded.
    columns : ndarray of complex, shape (B, K)
        Its K columns, see `dynamics.Columns`; the residual has variance 1 in real and imaginary part each.
    weights : Weights
        Of the bins.
    window : ndarray, shape (N,), or None
        The window of the run, which makes neighbouring bins one noise; None to take bins as independent.
    parameter_map : ndarray, shape (Q, P)
        Linear map from the fitted parameters to those of the run.
    first_bin : int
        Number of its first bin in the transform of the whole run.
    noise : NoiseModel or None
        By which it was whitened; None where it was its own residual.
    n_projected : int
        Real numbers that have been projected out of every column.
    f : ndarray, shape (B,), or None
        Their frequencies [Hz] where it was whitened by a PSD.
    names : sequence of str
        The first of the parameters of the run; the others are those of noisy read-outs.
    equation : Equation
        Of its columns.
    """

    tau: tuple[float, float]
    columns: Spectrum
    weights: Weights
    window: Array | None
    parameter_map: Array
    first_bin: int = 1
    noise: NoiseModel | None = None
    n_projected: int = 2
    f: Array | None = None
    names: Sequence[str] = dynamics.PARAMETERS
    equation: Equation = DELTA_G

    def coefficients(self, theta: Array) -> Array:
        """Return the coefficients of the columns, shape (K, ...), for theta, shape (P, ...)."""
        return self.equation.coefficients(self.parameter_map @ theta, self.tau)

    def run_gradient(self, theta: Array, /) -> Array:
        """Return the derivatives of `coefficients` by the parameters of the run, shape (K, Q)."""
        return self.equation.gradient(self.parameter_map @ theta, self.tau)

    def gradient(self, theta: Array) -> Array:
        """Return the derivatives of `coefficients` by theta, shape (K, P)."""
        return np.asarray(self.run_gradient(theta) @ self.parameter_map)

    def without_data(self) -> Self:
        """Return the equation of the run alone, for `coefficients` and `gradient`."""
        none = np.empty(0)
        return replace(
            self,
            columns=self.columns[:0].copy(),
            weights=Weights(none, none, none),
            window=None,
            noise=None,
            f=None,
        )

    @property
    def blocks(self) -> "tuple[WhitenedRun, ...]":
        """The run in each of its equations."""
        return (self,)

    @property
    def places(self) -> list[NDArray[np.intp]]:
        """The columns of each block among those of the run."""
        return [np.arange(self.columns.shape[1])]

    @property
    def size(self) -> int:
        """Number of real data, what was projected out taken off."""
        return 2 * len(self.columns) - self.n_projected

    @cached_property
    def R(self) -> Array:
        """Shape (K, K): ``|R c|^2`` is the weighted sum of squares for the coefficients c of the columns."""
        return self._root(self.weights.fit)

    @cached_property
    def root_level(self) -> Array:
        """As `R`, all bins alike but for the level of the noise."""
        level = np.ones(len(self.columns)) if self.weights.level is None else self.weights.level
        return self.R if np.array_equal(self.weights.fit, level) else self._root(level)

    @cached_property
    def H(self) -> Array:
        """Curvature of half the weighted sum, shape (K, K)."""
        is_fit = np.array_equal(self.weights.curvature, self.weights.fit)
        root = self.R if is_fit else self._root(self.weights.curvature)
        return np.asarray(root.T @ root)

    @cached_property
    def M(self) -> Array:
        """Covariance of the scores ``columns^T residual`` under noise of the estimated PSD, shape (K, K)."""
        if self.window is None:
            root = self._root(self.weights.score)
            return np.asarray(root.T @ root)
        # The window makes neighbouring bins one noise: the scores' covariance is not the information. In the
        # time domain the whitened noise is white, times w, so that the covariance is a plain sum.
        z, w2 = windowing.product_series(self._weighed(self.weights.score), self.first_bin, self.window)
        total = np.zeros((z.shape[1], z.shape[1]))
        for part in pieces(w2.size):
            total += z[part].T @ (z[part] * w2[part, None])
        return np.asarray((total + total.T) / 2)

    @cached_property
    def psd_scores(self) -> Array:
        """Covariance of the scores that the error of the PSD adds, shape (K, K).

        Commands that respond to the noise correlate with the residual in every bin; only the sum of the
        scores over the band vanishes, and only if every bin has its right weight. To first order an error of
        log S at the knots changes that sum by the scores of the bins about each knot. Where a signal stands
        above the noise this is small; without one, a run is known no better than its PSD.
        """
        if self.noise is None or self.f is None:
            return np.zeros(self.R.shape)
        residual = self.columns @ self.free_coefficients * self.weights.fit
        scores = np.real(self.columns.T.conj() * residual)
        at_knots = self.noise.basis(self.f).summed(scores)
        return np.asarray(at_knots @ self.noise.covariance @ at_knots.T)

    @property
    def products(self) -> Array:
        """Covariance of the scores, shape (K, K), of independent bins with the weights of the fit."""
        return np.asarray(self.R.T @ self.R)

    @property
    def noise_directions(self) -> Array:
        """Directions of the coefficients but the first in which columns are noise, as columns (K - 1, n)."""
        return np.zeros((self.columns.shape[1] - 1, 0))

    @property
    def free_coefficients(self) -> Array:
        """Coefficients that fit the run best, shape (K,), the first of them 1."""
        scale = np.linalg.norm(self.R[:, 1:], axis=0)
        scale[scale == 0] = 1.0  # a constant channel
        c = np.linalg.lstsq(self.R[:, 1:] / scale, -self.R[:, 0])[0] / scale
        return np.concatenate([[1.0], c])

    def root(self, bins: slice) -> Array:
        """Return the same as `root_level` for some of the bins."""
        return np.asarray(np.linalg.qr(as_real(self.columns[bins]), mode="r"))

    def _root(self, factors: Array) -> Array:
        return qr_factor(as_real(self._weighed(factors)))

    def _weighed(self, factors: Array) -> Spectrum:
        return self.columns if np.all(factors == 1) else self.columns * np.sqrt(factors)[:, None]


class LinearRun(WhitenedRun):
    """A whitened run of K columns, of which the first stands alone and theta multiplies the others."""

    def coefficients(self, theta: Array) -> Array:
        """As those of `WhitenedRun`."""
        return np.concatenate([np.ones_like(theta[:1]), theta])

    def gradient(self, theta: Array) -> Array:
        """As that of `WhitenedRun`."""
        return np.eye(theta.size + 1, theta.size, k=-1)


def whiten(spectra: Spectra, S: Array, n_bins: int | None = None) -> tuple[Spectrum, Array]:
    """Scale to unit variance of real and imaginary part each and project constant, ramp and glitches out.

    Sums of products of such columns are the products (a | b) of Eq. (13). Not all bins need be given.

    Returns
    -------
    columns : ndarray of complex, shape (B, P)
        Whitened columns.
    fraction : ndarray, shape (B,)
        The fraction of the power that the projection leaves, from 0 to 1.
    """
    scale, Q = np.repeat(np.sqrt(2 / S), 2), project_out(spectra, S)
    columns, rows = as_real(spectra.columns).T, slice(None if n_bins is None else 2 * n_bins)
    scaled = scale[rows]
    U = columns[:, rows] * scaled  # one row for each column, as they lie
    n_projected = U @ Q if n_bins is None else columns @ (Q * scale[:, None])
    for part in pieces(U.shape[1]):
        U[:, part] -= n_projected @ Q[part].T
    of_bins = Q[rows].reshape(U.shape[1] // 2, -1)
    return U.view(np.complex128).T, np.asarray(1 - np.einsum("bi,bi->b", of_bins, of_bins) / 2, np.float64)


def project_out(spectra: Spectra, S: Array) -> Array:
    """Return orthonormal columns, shape (2 B, G), that span what `whiten` projects out."""
    return orthonormal((as_real(spectra.nuisance).T * np.repeat(np.sqrt(2 / S), 2)).T)


def orthonormal(rows: Array) -> Array:
    """Return orthonormal columns that span those of rows, shape (M, K), in their place: without any copy."""
    factors, tau, *_ = lapack.dgeqrf(rows, overwrite_a=True)  # as scipy.linalg.qr, in a tenth of its time
    return np.asarray(lapack.dorgqr(factors, tau, overwrite_a=True)[0])


def qr_factor(rows: Array) -> Array:
    """Return the triangle R of the QR factors of rows, shape (M, K)."""
    return np.asarray(np.triu(lapack.dgeqrf(rows)[0][: rows.shape[1]]))


def as_real(x: Spectrum) -> Array:
    """Return real and imaginary part of every bin in turn, shape (2 B, ...); no copy of `Spectra`."""
    return np.ascontiguousarray(x.T).view(np.float64).T


def matrix_sqrt(squares: Array) -> Array:
    """Return K rows whose products sum up to a covariance, shape (K, K), however its columns are scaled."""
    scale = np.sqrt(np.diag(squares))
    scale[scale == 0] = 1.0  # a column without noise
    values, vectors = np.linalg.eigh(squares / np.outer(scale, scale))
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0))).T * scale)


def whiten_run(
    spectra: Spectra,
    noise: NoiseModel,
    parameter_map: Array,
    *,
    likelihood: Likelihood = "gaussian",
    c: Array | None = None,
    equation: Equation = DELTA_G,
) -> WhitenedRun:
    """Whiten one run by the PSD of its noise and weigh its bins.

    Parameters
    ----------
    spectra : Spectra
        The run.
    noise : NoiseModel
        Of its noise.
    parameter_map : ndarray, shape (Q, P)
        See `WhitenedRun`.
    likelihood : str
        What the residual is taken to be like.
    c : ndarray, shape (K,), optional
        Coefficients of the columns at the previous estimate, which make the residual that gives the weights.
    equation : Equation
        Of the columns.
    """
    U, _ = whiten(spectra, noise.expected(spectra.f))
    u = np.full(len(U), 2.0) if c is None else np.abs(U @ c) ** 2
    of_bins, n_projected = weights(likelihood, spectra.f, u), spectra.nuisance.shape[1]
    return WhitenedRun(
        spectra.tau,
        U,
        of_bins,
        spectra.window,
        parameter_map,
        noise=noise,
        n_projected=n_projected,
        f=spectra.f,
        equation=equation,
    )


def information(blocks: Sequence[WhitenedRun], theta: Array) -> Array:
    """Return the curvature of the cost that the data make at theta, shape (P, P)."""
    gradients = [(block.gradient(theta), block.H) for block in blocks]
    return sum((J.T @ H @ J for J, H in gradients), np.zeros((theta.size, theta.size)))


@dataclass(frozen=True)
class Solution:
    """The minimum of chi^2.

    Attributes
    ----------
    theta : ndarray, shape (P,)
        Parameters, SI.
    covariance : ndarray, shape (P, P)
        True covariance, window and priors included.
    chi2 : float
        Of the data, priors left out.
    dof : int
        Data less the directions they determine.
    """

    theta: Array
    covariance: Array
    chi2: float
    dof: int

    @property
    def sigma(self) -> Array:
        """Standard deviations, shape (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def in_sigma(self, change: Array) -> Array:
        """Return a change of the parameters, shape (P,), in sigmas; zero for what is fixed."""
        return in_sigma(change, self.covariance)


def in_sigma(change: Array, covariance: Array) -> Array:
    """Return a change of parameters, shape (P,), in sigmas of their covariance; zero for what is fixed."""
    sigma = np.sqrt(np.diag(covariance))
    return np.divide(change, sigma, out=np.zeros(sigma.size), where=sigma > 0)


def scaled_inverse(H: Array, free: Array | None = None) -> Array:
    """Return the inverse of an information matrix, shape (P, P), whatever the units of its parameters.

    Parameters
    ----------
    H : ndarray, shape (P, P)
        Information.
    free : ndarray, shape (P, F), optional
        Directions in which the parameters vary: the inverse is that within them, zero across.

    Raises
    ------
    FitError
        If it is singular.
    """
    if free is not None:
        return np.asarray(free @ scaled_inverse(free.T @ H @ free) @ free.T)
    scale = 1 / np.sqrt(np.abs(np.diag(H)))
    try:
        return np.asarray(scale[:, None] * np.linalg.inv(scale[:, None] * H * scale) * scale)
    except np.linalg.LinAlgError as error:
        raise FitError("the data and the weak priors leave a direction free") from error
