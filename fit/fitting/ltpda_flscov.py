"""Iteratively reweighted least squares as LTPDA's ``flscov`` does it with its default settings (Eq. (7)).

Ten stretches of a run overlap by two thirds under a Blackman-Harris window; of their transforms every fourth
bin counts, from the fifth on. Each bin is weighted by its power in the residual of the previous iteration,
averaged over the stretches, and all stretches count as independent. It is here to be compared with: such
weights are themselves noise, which makes the estimates scatter more than their sigmas say. The commands are
delayed as in the other fits, where LTPDA linearises about zero delay.

By how much they scatter is known beforehand. Where the iteration ends, the score of a bin is
``10 Re(d^H r) / (r^H r)`` of its ten transforms of the residual r and of a derivative d. The overlaps
correlate those of r as the window says, so that along the eigenvectors of the correlation matrix, of
eigenvalues lambda, they are independent. What is expected of the score's square and derivative then needs no
more than ``E[1 / r^H r]`` and ``E[|r_k|^2 / (r^H r)^2]``. Both are integrals over one variable, because
``E[exp(-t r^H r)]`` is the product of all ``1 / (1 + lambda_k t)``.
"""

import math
from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import Columns, Equation
from fit.spectra import Spectrum, derivatives
from fit.whitening import Weights, WhitenedRun, whitened_run

Array = NDArray[np.float64]

SEGMENTS, OVERLAP = 10, 0.661
FIRST_BIN, STRIDE = 4, 4
TOLERANCE = 1e-6  # relative change of the summed weights
NODES = 200  # of the integrals


def transform(terms: Columns) -> tuple[Array, Spectrum]:
    """Return frequencies [Hz], shape (B,), and the transforms of the stretches, shape (10, B, P).

    Their scale is that of `spectra.Spectra`. Missing samples have been bridged by straight lines.
    """
    w, starts = _stretches(len(terms.values))
    n = w.size
    bins = slice(FIRST_BIN, math.floor(min(derivatives.F_MAX, terms.fs / 10) * n / terms.fs) + 1, STRIDE)
    scale = math.sqrt(2 / (terms.fs * float(w @ w)))
    spectra = [scipy.fft.rfft(w[:, None] * terms.values[a : a + n], axis=0)[bins] * scale for a in starts]
    return np.arange(n // 2 + 1)[bins] * terms.fs / n, np.stack(spectra)


def _stretches(N: int) -> tuple[Array, NDArray[np.int64]]:
    """Return the window of the stretches of a run of N samples, and where they begin, shape (10,)."""
    n = math.floor(N / (1 + (SEGMENTS - 1) * (1 - OVERLAP)))
    w = np.asarray(scipy.signal.windows.blackmanharris(n, sym=False), dtype=np.float64)
    return w, np.minimum(np.arange(SEGMENTS) * round(n * (1 - OVERLAP)), N - n)


def block(terms: Columns, equation: Equation, share: Array, c: Array | None) -> tuple[WhitenedRun, float]:
    """Weigh an equation of a run by its own residual, without coefficients `c` of its columns all bins alike.

    Returns
    -------
    block : WhitenedRun
        For the joint model.
    total : float
        The summed weights' denominators, whose change decides when to stop.
    """
    f, columns = transform(terms)
    columns = columns if equation.basis is None else columns @ equation.basis
    S = np.ones(f.size) if c is None else np.mean(np.abs(columns @ c) ** 2, axis=0)
    U = (columns * np.sqrt(2 / S)[:, None]).reshape(-1, columns.shape[2])
    one = np.ones(len(U))
    even = Weights(one, one, one)
    return WhitenedRun(terms.tau, U, even, None, share, equation=equation), float(np.sum(S))


def expected(
    terms: Columns,
    equation: Equation,
    noise_functions: Callable[[Array], tuple[Array, Array]],
    share: Array,
) -> WhitenedRun:
    """Return the run that `block` is expected to make of noise, its estimates as scattered as they will be.

    Parameters
    ----------
    terms : Columns
        The columns of the run without noise.
    equation : Equation
        With K columns.
    noise_functions : callable
        From frequencies [Hz], shape (B,), to the cross powers of the noise in the columns, shape (B, K, K),
        and the PSD of the residual, shape (B,).
    share : ndarray, shape (K - 1, P)
        The `parameter_map` of a `WhitenedRun`.

    Returns
    -------
    WhitenedRun
        Its rows are the bins along every eigenvector of the correlation of the stretches, and K rows for the
        noise in the columns along each of them.
    """
    f, columns = transform(terms)
    columns = columns if equation.basis is None else columns @ equation.basis
    power, S = noise_functions(f)
    w, starts = _stretches(len(terms.values))
    values, vectors = _modes(w, starts)
    phases = np.exp(-2j * np.pi * np.outer(starts, f) / terms.fs)  # one time for all stretches
    U = columns * np.sqrt(2 / S)[:, None]
    rows = np.einsum("sk,sb,sbp->kbp", vectors, phases, U, optimize=True)
    jitter = whitened_run.matrix_sqrt(np.sum(power * (2 / S)[:, None, None], axis=0))
    rows = np.concatenate([rows, np.sqrt(values)[:, None, None] * jitter], axis=1)
    fit, curvature, score = (np.repeat(factor, rows.shape[1]) for factor in _expected_weights(values))
    even = Weights(fit, curvature, score)
    return WhitenedRun(terms.tau, rows.reshape(-1, U.shape[2]), even, None, share, equation=equation)


def _modes(w: Array, starts: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return eigenvalues, shape (10,), and eigenvectors of how noise correlates the stretches."""
    lags = np.abs(starts[:, None] - starts)
    overlap = {int(lag): float(w[lag:] @ w[: w.size - lag]) for lag in np.unique(lags[lags < w.size])}
    R = np.array([[overlap.get(int(lag), 0.0) for lag in row] for row in lags]) / (w @ w)
    values, vectors = np.linalg.eigh(R)
    return np.maximum(values, 0.0), vectors


def _expected_weights(values: Array) -> tuple[Array, Array, Array]:
    """Return those of fit, curvature and score, shape (10,) each, along eigenvectors of these eigenvalues."""
    x, chance = np.polynomial.legendre.leggauss(NODES)
    t, chance = (1 + x) / (1 - x), chance * 2 / (1 - x) ** 2
    shrunk = 1 / (1 + np.outer(values, t))
    all_of_them = np.prod(shrunk, axis=0) * chance
    inverse = float(np.sum(all_of_them))  # E[1 / r^H r]
    share = values * (shrunk @ (t * all_of_them))  # E[|r_k|^2 / (r^H r)^2]
    even = np.full(values.size, SEGMENTS * inverse)
    return even, even - SEGMENTS * share, SEGMENTS**2 * share
