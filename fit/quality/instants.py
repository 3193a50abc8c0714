"""What a change of some columns gains, at every instant of a stretch of a run, without a transform for each.

Columns that begin at instant i are, whitened, the sum of those that begin once the stretch is over and of its
samples from i on. Their products with one another and with anything else are sums over samples, in which
the whitening is the kernel of a convolution: from one instant to the next a single sample joins them.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.spectra import Spectra, windowing
from fit.whitening import whitened_run

Array = NDArray[np.float64]

ALIKE = 1e-12  # least eigenvalue over the largest: products of columns that tell no more than this are noise


class Stretch:
    """A stretch of a run in which something may begin.

    Parameters
    ----------
    terms : Spectra
        The run.
    S : ndarray, shape (B,)
        PSD of its noise.
    known : ndarray, shape (2 B, K)
        Whitened and orthonormal, what is free in any case.
    rest : ndarray, shape (2 B,)
        What it leaves of the run.
    samples : slice
        Of the M samples of the stretch.
    """

    def __init__(self, terms: Spectra, S: Array, known: Array, rest: Array, samples: slice) -> None:
        self._terms, self._S, self._known, self._rest, self._samples = terms, S, known, rest, samples
        n, w = terms.window.size, terms.window
        self._scale = np.sqrt(4 / (_rate(terms) * float(w @ w) * S))
        length = samples.stop - samples.start
        self._kernel = (
            n / 2 * windowing.inverse_transform((self._scale**2 + 0j)[:, None], terms.first, n)[:length, 0]
        )
        self._of_rest = self._seen(rest[:, None])
        self._of_free = self._seen(np.linalg.qr(np.hstack([whitened_run.project_out(terms, S), known]))[0])

    def gains(self, columns: Array) -> Array:
        """Return by how much chi2 falls if columns, shape (C, N), begin at each instant, shape (M,)."""
        at, terms = self._samples, self._terms
        later = columns.copy()
        later[:, : at.stop] = 0
        E = whitened(terms, self._S, self._known, later)
        x = (columns[:, at] * terms.window[at]).T
        b = E.T @ self._rest + _from_each_on(x * self._of_rest)
        apart = _from_each_on(self._seen(E)[:, :, None] * x[:, None, :])
        free = _from_each_on(self._of_free[:, :, None] * x[:, None, :])
        G = E.T @ E + apart + apart.swapaxes(1, 2) + self._products(x) - free.swapaxes(1, 2) @ free
        norms = np.sqrt(np.einsum("mkk->mk", G).clip(0))
        norms[norms == 0] = 1.0
        b /= norms
        inverse = np.linalg.pinv(G / (norms[:, :, None] * norms[:, None, :]), ALIKE, hermitian=True)
        return np.asarray(np.einsum("mk,mkl,ml->m", b, inverse, b))

    def _seen(self, series: Array) -> Array:
        """Return the products of J whitened series with an impulse at each of the samples, shape (M, J)."""
        n, terms = self._terms.window.size, self._terms
        found = np.empty((self._kernel.size, series.shape[1]))
        for k, column in enumerate(series.T):
            bins = np.ascontiguousarray(column).view(np.complex128) * self._scale
            found[:, k] = n / 2 * windowing.inverse_transform(bins[:, None], terms.first, n)[self._samples, 0]
        return found

    def _products(self, x: Array) -> Array:
        """Return the products of what samples from each on make, whitened, shape (M, C, C)."""
        later = self._kernel.copy()
        later[0] /= 2
        behind = np.stack([np.convolve(of[::-1], later)[: of.size][::-1] for of in x.T], axis=1)
        joins = x[:, :, None] * behind[:, None, :]
        return _from_each_on(joins + joins.swapaxes(1, 2))


def whitened(terms: Spectra, S: Array, known: Array, columns: Array) -> Array:
    """Return what columns, shape (C, N), have besides what is free in any case, see `Stretch`: (2 B, C)."""
    found = windowing.windowed_spectra(columns.T, terms.window, _rate(terms), terms.bins)
    E = whitened_run.as_real(whitened_run.whiten(replace(terms, columns=found), S)[0])
    return np.asarray(E - known @ (known.T @ E))


def _rate(terms: Spectra) -> float:
    """Return the sample rate [Hz] of the columns that were transformed."""
    return float(terms.f[0] * terms.window.size / terms.first)


def _from_each_on(x: Array) -> Array:
    """Return the sums from every sample to the last, shape (M, ...)."""
    return np.cumsum(x[::-1], axis=0)[::-1]
