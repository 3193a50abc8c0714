"""The noise of read-outs that are columns and residual at once, taken off by what the noise run has of it.

D is limited by the capacitive read-outs of y, whose second derivatives are columns of the model as well: the
square of their noise joins the scores and pulls gains towards what would make the noise least. With columns U
and coefficients c of the noise run, weighed alike, the mean of these scores is ``N c`` with ``N = U^T U``
times the ratio of the numbers of bins. Corrected least squares solve ``(R^T R - N) c = 0`` instead: what the
noise makes of the curvature is no information either. Least squares on tilt-to-length has the same bias
(arXiv 2410.16475).
"""

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.fitting.run_estimate import whitened_directions
from fit.spectra import NoiseModel, Spectra
from fit.whitening import WhitenedRun, whitened_run

Array = NDArray[np.float64]

LEAST_SIGNAL = 0.01  # share of the power, which a noise run does not separate from none
MOSTLY = 0.5  # share of signal below which a direction is one of noise


@dataclass(frozen=True)
class CorrectedRun(WhitenedRun):
    """A whitened run whose scores and curvature are corrected.

    Attributes
    ----------
    noise_products : ndarray, shape (K, K)
        N, for the number of bins and the level of the noise of the run.
    noise_bins : float
        Number of bins of the run over that of the noise run.
    c : ndarray, shape (K,)
        Coefficients of the columns at the previous estimate.
    """

    noise_products: Array = field(kw_only=True)
    noise_bins: float = field(kw_only=True)
    c: Array = field(kw_only=True)

    @cached_property
    def R(self) -> Array:
        """As that of `WhitenedRun`."""
        V, signal = self._directions
        scores = V.T @ (self._products - self.noise_products)[1:, :1]
        share = np.sqrt(np.maximum(signal, LEAST_SIGNAL))[:, None]
        return np.concatenate([scores / share, share * (V.T @ self._products[1:, 1:])], axis=1)

    @cached_property
    def root_level(self) -> Array:
        """As that of `WhitenedRun`, not corrected: the residual has the power it has."""
        level = np.ones(len(self.columns)) if self.weights.level is None else self.weights.level
        return self._root(level)

    @cached_property
    def H(self) -> Array:
        """As that of `WhitenedRun`."""
        ratio = float(np.mean(self.weights.curvature) / np.mean(self.weights.fit))
        return np.asarray(self.R.T @ self.R * ratio)

    @cached_property
    def M(self) -> Array:
        """As that of `WhitenedRun`, with the covariance of what is subtracted."""
        return np.asarray(super().M + self.noise_bins * self.noise_products)

    @property
    def products(self) -> Array:
        """As that of `WhitenedRun`, not corrected: noise has a covariance too."""
        return self._products + self.noise_bins * self.noise_products

    @property
    def noise_directions(self) -> Array:
        """As that of `WhitenedRun`."""
        V, signal = self._directions
        return np.asarray(V[:, signal < MOSTLY])

    @property
    def free_coefficients(self) -> Array:
        """Those of the previous estimate: in directions of noise, none fit best."""
        return self.c

    @cached_property
    def _products(self) -> Array:
        root = self._root(self.weights.fit)
        return np.asarray(root.T @ root)

    @cached_property
    def _directions(self) -> tuple[Array, Array]:
        """V, shape (K - 1, r), with ``V.T @ products @ V = 1``, and the share of signal in their powers."""
        V = whitened_directions(self._products[1:, 1:])
        noise, turn = np.linalg.eigh(V.T @ self.noise_products[1:, 1:] @ V)
        return V @ turn, 1 - noise


def corrected(run: WhitenedRun, noise_run: Spectra, noise: NoiseModel, c: Array | None) -> CorrectedRun:
    """Return a whitened run without what the noise of its columns adds to the scores.

    Parameters
    ----------
    run : WhitenedRun
        The run.
    noise_run : Spectra
        The same columns of its noise run.
    noise : NoiseModel
        Of the residual.
    c : ndarray, shape (K,), or None
        Coefficients of the columns at the previous estimate, if there is one.
    """
    lowest = noise_run.f[0] if run.f is None else run.f[0]
    U, _ = whitened_run.whiten(noise_run, noise.expected(noise_run.f))
    root = whitened_run.qr_factor(whitened_run.as_real(U[noise_run.f >= lowest]))
    share = len(run.columns) / np.count_nonzero(noise_run.f >= lowest)
    level = 1.0 if c is None else float(np.sum((run.R @ c) ** 2)) / run.size
    known = {x.name: getattr(run, x.name) for x in fields(WhitenedRun)}
    return CorrectedRun(
        **known,
        noise_products=share * level * (root.T @ root),
        noise_bins=share,
        c=run.free_coefficients if c is None else c,
    )
