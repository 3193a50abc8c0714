"""A whitened run, compressed to its own estimates and their true covariance.

The coefficients c of the columns of a run (`fit.model.dynamics.coefficients`) that fit it best by themselves
are a complete summary of it: with the curvature H of its chi^2 and the covariance M of the scores, which
allows for the window, they have the covariance ``V = H^-1 M H^-1``. All that a joint fit needs of a run of
any length is c and a square root of V^-1.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fit.spectra import windowing
from fit.whitening import WhitenedRun, expected_weights

Array = NDArray[np.float64]

NULL = 1e-10  # information relative to the largest, below which a run does not determine a direction


class Equation(Protocol):
    """Coefficients of the columns of a run; the first is that of the column without a parameter."""

    def coefficients(self, theta: Array) -> Array:
        """Return the coefficients, shape (K + 1,), at the fitted parameters theta, shape (P,)."""

    def gradient(self, theta: Array) -> Array:
        """Return their derivatives by theta, shape (K + 1, P)."""


@dataclass(frozen=True)
class RunEstimate:
    """One whitened run, compressed.

    Attributes
    ----------
    name : str
        Of the experiment.
    c : ndarray, shape (K,)
        Least-squares coefficients of its columns, the first of which has the coefficient 1.
    root : ndarray, shape (r, K)
        ``root.T @ root`` is the inverse of their covariance, window included; r < K where the run does not
        determine all of them.
    equation : Equation
        From the fitted parameters to the coefficients.
    psd_covariance : ndarray, shape (r, r), or None
        What the error of the PSD adds to the covariance of `residual`; it does not weight the run, so that no
        estimate depends on it.
    """

    name: str
    c: Array
    root: Array
    equation: Equation
    psd_covariance: Array | None = None

    def residual(self, theta: Array) -> Array:
        """Return by how much the run departs from theta, shape (P,), in units of its noise, shape (r,)."""
        return np.asarray(self.root @ (self.equation.coefficients(theta)[1:] - self.c))

    def jacobian(self, theta: Array) -> Array:
        """Return the derivatives of `residual` by theta, shape (r, P)."""
        return np.asarray(self.root @ self.equation.gradient(theta)[1:])


def run_estimate(name: str, run: WhitenedRun) -> RunEstimate:
    """Compress the whitened run of an experiment."""
    R = run.R
    H, M = moments(run)
    W = score_whitening(H, M)
    scores = W @ R[:, 1:].T @ R  # in units of their noise, by column
    scale = column_scale(H)
    c = scale * np.linalg.lstsq(scores[:, 1:] * scale, -scores[:, 0], rcond=None)[0]
    has_psd = any(block.noise for block in run.blocks)
    psd_covariance = W @ run.psd_scores[1:, 1:] @ W.T if has_psd else None
    return RunEstimate(name, c, W @ H, run.without_data(), psd_covariance)


def moments(run: WhitenedRun) -> tuple[Array, Array]:
    """Return the curvature of a run and the covariance of its scores, both of shape (K, K).

    A Student-t weights every bin by its own residual. A tone lies in few bins, and what these happen to be
    would weigh one run against another. Both are then the sum of weighted squares times what is expected of
    their factors, so that the joint fit is where the likelihood has its maximum.
    """
    if run.weights.likelihood != "student_t":
        return run.H[1:, 1:], run.M[1:, 1:]
    expected = expected_weights("student_t", np.arange(1.0, len(run.columns) + 1))
    fit, curvature, score = (
        float(np.mean(factors)) for factors in (expected.fit, expected.curvature, expected.score)
    )
    window = 1.0 if run.window is None else windowing.variance_factor(run.window)
    return run.R[:, 1:].T @ run.R[:, 1:], run.products[1:, 1:] * score * window * fit / curvature**2


def column_scale(H: Array) -> Array:
    """Return what scales columns of curvature H to unit length, shape (K,); zero for constant channels."""
    diagonal = np.diag(H)
    return np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)


def score_whitening(H: Array, M: Array) -> Array:
    """Return the map from scores of curvature H and covariance M, (K, K), to unit noise, shape (r, K)."""
    V = whitened_directions(H)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(V.T @ M @ V), V.T))


def whitened_directions(H: Array) -> Array:
    """Return the directions V that a curvature H, (K, K), determines, (K, r), with ``V.T @ H @ V = 1``."""
    scale = column_scale(H)
    values, vectors = np.linalg.eigh(scale[:, None] * H * scale)
    determined = values > NULL * values[-1]
    return np.asarray(scale[:, None] * vectors[:, determined] / np.sqrt(values[determined]))
