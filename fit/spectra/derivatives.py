"""Preprocessing of sampled channels: gaps, low-pass, decimation, exact derivatives and delays.

Everything that differentiates or delays acts in the time domain on unwindowed data; (i omega)^2 applied to
windowed data would turn the slope of the window into signal. Window and transform come after (`spectra`).
"""

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit import requirements
from fit.telemetry import PIECE, pieces

Array = NDArray[np.float64]

F_MAX = requirements.F_MAX
RATE = 1.0  # Hz, lowest rate after decimation
HALF = 10  # samples on either side of a stencil: gain right to 1e-10 below F_MAX at 1 Hz
RIPPLE = 100.0  # dB, what the low-pass leaves of what would alias into the band
_BLOCK = 20  # outputs of a stencil in one row of a matrix: the least work beside what is computed twice
LONGEST_GAP = 1.0  # s, longest gap that is interpolated rather than masked


@lru_cache(maxsize=64)
def stencil(shift: float, order: int) -> Array:
    """Return the weights that give a derivative of the interpolating polynomial, exact to degree 2 HALF.

    Constants and ramps have exactly the derivative they should, so that a second derivative lets no offset
    through (an offset would pass for stiffness).

    Parameters
    ----------
    shift : float
        Delay in samples, well below HALF.
    order : int
        Of the derivative, per sample.

    Returns
    -------
    ndarray, shape (2 HALF + 1,)
        To be applied with `apply_stencil`.
    """
    powers = np.arange(2 * HALF + 1)
    nodes = np.arange(-HALF, HALF + 1) / HALF
    moments = [math.perm(m, order) * (-shift / HALF) ** (m - order) if m >= order else 0.0 for m in powers]
    weights = np.linalg.solve(nodes ** powers[:, None], np.array(moments) / HALF**order)
    weights.flags.writeable = False  # cached
    return weights


def apply_stencil(weights: Array, x: Array) -> Array:
    """Return ``sum_k weights[k] x[n + k]`` wherever the stencil fits; 2 HALF samples shorter than `x`."""
    return np.correlate(x, weights, mode="valid")


def apply_stencils(weights: Array, x: Array) -> Array:
    """Apply several stencils, shape (K, 2 HALF + 1), by products of matrices; see `apply_stencil`."""
    K, size = weights.shape
    shifted = np.zeros((K, _BLOCK, _BLOCK + size - 1))
    for i in range(_BLOCK):
        shifted[:, i, i : i + size] = weights
    derivatives = np.empty((K, x.size - size + 1))
    for piece in pieces(x.size, size - 1, PIECE // _BLOCK * _BLOCK):
        n = piece.stop - piece.start - size + 1
        rows = -(-n // _BLOCK)
        padded = np.zeros(rows * _BLOCK + size - 1)
        padded[: n + size - 1] = x[piece]
        blocks = np.ascontiguousarray(sliding_window_view(padded, _BLOCK + size - 1)[::_BLOCK])
        products = (blocks @ shifted.reshape(K * _BLOCK, -1).T).reshape(rows, K, _BLOCK).swapaxes(0, 1)
        derivatives[:, piece.start : piece.start + n] = products.reshape(K, -1)[:, :n]
    return derivatives


def derivative(x: Array, fs: float, order: int, delay: float = 0.0) -> Array:
    """Return a derivative of a channel [per s^order], delayed [s]; 2 HALF samples shorter than `x`."""
    return np.asarray(apply_stencils(stencil(delay * fs, order)[None] * fs**order, x)[0])


def held_command(x: Array, fs: float, delay: float, period: float) -> Array:
    """Return a command that is held for a `period` [s], delayed [s], and its slope [per s], shape (N, 2)."""
    curve = (period * fs) ** 2 / 24
    value, slope, curvature = (stencil(delay * fs, order) for order in (0, 1, 2))
    # mean over a hold, f + h^2/24 f'': the force that acts is weaker than the command by sinc(f h)
    return apply_stencils(np.stack([value + curve * curvature, fs * slope]), x).T


def dilate_mask(masked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which outputs of a stencil depend on masked samples; 2 HALF samples shorter."""
    if not masked.any():
        return np.zeros(max(masked.size - 2 * HALF, 0), dtype=bool)
    return apply_stencil(np.ones(2 * HALF + 1), masked.astype(float)) > 0.5


def interpolate_gaps(x: Array, fs: float) -> tuple[Array, NDArray[np.bool_]]:
    """Interpolate missing samples (NaN), and mask the gaps that are too long for it.

    Returns
    -------
    filled : ndarray, shape (N,)
        `x` with a cubic spline through the short gaps and straight lines through the others.
    masked : ndarray of bool, shape (N,)
        True in gaps longer than `LONGEST_GAP`.
    """
    missing = np.isnan(x)
    if not missing.any():
        return x, missing
    if np.count_nonzero(~missing) < 2:
        return np.zeros_like(x), np.ones_like(missing)
    masked = np.zeros_like(missing)
    for start, stop in true_runs(missing):
        masked[start:stop] = stop - start > max(1.0, LONGEST_GAP * fs)
    n, short = np.arange(x.size), missing & ~masked
    filled = x.copy()
    filled[masked] = np.interp(n[masked], n[~missing], x[~missing])
    if short.any():
        filled[short] = scipy.interpolate.CubicSpline(n[~missing], x[~missing])(n[short])
    return filled, masked


def true_runs(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return first index and end of every run of True, shape (number of runs, 2)."""
    return np.flatnonzero(np.diff(flags, prepend=False, append=False)).reshape(-1, 2)


@lru_cache(maxsize=16)
def low_pass(fs: float, f_max: float = F_MAX, rate: float = RATE) -> tuple[Array, int]:
    """Return the taps of the common zero-phase filter and the decimation it makes safe, 1 below twice `rate`.

    Flat to 10^(-RIPPLE/20) up to `f_max`; the same filter on every column leaves the equation as it is.
    """
    factor = max(1, math.floor(fs / rate + 1e-9))
    if factor == 1:
        return np.ones(1), 1
    width = fs / factor - 2 * f_max  # from f_max to where aliases would reach f_max
    half = (RIPPLE - 7.95) / (2.285 * 2 * math.pi * width / fs) / 2
    half = factor * math.ceil(half / factor)
    taps = scipy.signal.firwin(
        2 * half + 1, f_max + width / 2, window=("kaiser", 0.1102 * (RIPPLE - 8.7)), fs=fs
    )
    taps.flags.writeable = False  # cached
    return taps, factor


def decimate(x: Array, taps: Array, factor: int) -> Array:
    """Filter and keep every factor-th sample, the first at index ``taps.size // 2`` of `x`.

    What `low_pass` leaves as it is comes back as it is.
    """
    if factor == 1:
        return x
    order = taps.size - 1  # a multiple of factor
    n = (x.size - 1 - order) // factor + 1
    if n < 1:
        return np.empty(0)
    # an output is a sum of products of `factor` samples in a row with as many taps: one product of matrices
    rows = x[: (n - 1) * factor + order].reshape(-1, factor)
    products = taps[:0:-1].reshape(-1, factor) @ rows.T
    filtered: Array = taps[0] * x[order::factor][:n]
    for k, row in enumerate(products):
        filtered += row[k : k + n]
    return filtered


def _chunks(x: Array, taps: Array, factor: int) -> Iterator[slice]:
    """Yield slices of a channel that can be decimated separately, with the same result."""
    return pieces(x.size, taps.size - 1, PIECE // factor * factor)


def preprocess(
    x: Array, fs: float, taps: Array, factor: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Interpolate the gaps of a channel, shape (N,), filter and decimate it.

    Returns
    -------
    decimated : ndarray, shape (M,)
        The channel.
    masked : ndarray of bool, shape (M,)
        True where the filter reaches a gap longer than `LONGEST_GAP`.
    missing : ndarray of bool, shape (N,), or (1,)
        True where samples are missing; one False for all if none is.
    """
    chunks = []
    for span in _chunks(x, taps, factor):
        chunk = x[span]
        if np.isnan(chunk).any():
            return _preprocess_gaps(x[:], fs, taps, factor)
        chunks.append(decimate(chunk, taps, factor))
    decimated = np.concatenate([np.empty(0), *chunks])
    return decimated, np.zeros(decimated.size, dtype=bool), np.zeros(1, dtype=bool)


def _preprocess_gaps(
    x: Array, fs: float, taps: Array, factor: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Preprocess a channel with missing samples."""
    filled, masked = interpolate_gaps(x, fs)
    decimated = decimate(filled, taps, factor)
    if not masked.any():
        return decimated, np.zeros(decimated.size, dtype=bool), np.isnan(x)
    return decimated, decimate(masked.astype(float), np.ones_like(taps), factor) > 0.5, np.isnan(x)
