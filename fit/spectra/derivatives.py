"""Sampled channels made ready: gaps bridged, low-passed, decimated, exactly differentiated and delayed.

Everything that differentiates or delays acts in the time domain on unwindowed data; (i omega)^2 applied to
windowed data would turn the slope of the window into signal. Window and transform come after (`spectra`).
"""

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fit import requirements
from fit.spectra import windows
from fit.telemetry import PIECE, Row, pieces

Array = NDArray[np.float64]

F_MAX = requirements.F_MAX
RATE = 1.0  # Hz, least rate after decimation
HALF = 10  # samples on either side of a stencil: gain right to 1e-10 below F_MAX at 1 Hz
RIPPLE = 100.0  # dB, what the low-pass leaves of what would alias into the band
_AT_ONCE = 20  # outputs of a stencil in one row of a matrix: the least work beside what is computed twice
BRIDGE = 1.0  # s, longest stretch of missing samples that is interpolated rather than masked


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
        To be applied with `apply`.
    """
    powers = np.arange(2 * HALF + 1)
    nodes = np.arange(-HALF, HALF + 1) / HALF
    moments = [math.perm(m, order) * (-shift / HALF) ** (m - order) if m >= order else 0.0 for m in powers]
    found = np.linalg.solve(nodes ** powers[:, None], np.array(moments) / HALF**order)
    found.flags.writeable = False  # others get the same one
    return found


def apply(weights: Array, x: Array) -> Array:
    """Return ``sum_k weights[k] x[n + k]`` wherever the stencil fits; 2 HALF samples shorter than `x`."""
    return np.correlate(x, weights, mode="valid")


def apply_each(weights: Array, x: Array) -> Array:
    """Return what `apply` does for several stencils, shape (K, 2 HALF + 1), by products of matrices."""
    K, size = weights.shape
    shifted = np.zeros((K, _AT_ONCE, _AT_ONCE + size - 1))
    for i in range(_AT_ONCE):
        shifted[:, i, i : i + size] = weights
    found = np.empty((K, x.size - size + 1))
    for piece in pieces(x.size, size - 1, PIECE // _AT_ONCE * _AT_ONCE):
        n = piece.stop - piece.start - size + 1
        rows = -(-n // _AT_ONCE)
        padded = np.zeros(rows * _AT_ONCE + size - 1)
        padded[: n + size - 1] = x[piece]
        parts = np.ascontiguousarray(sliding_window_view(padded, _AT_ONCE + size - 1)[::_AT_ONCE])
        of_piece = (parts @ shifted.reshape(K * _AT_ONCE, -1).T).reshape(rows, K, _AT_ONCE).swapaxes(0, 1)
        found[:, piece.start : piece.start + n] = of_piece.reshape(K, -1)[:, :n]
    return found


def derivative(x: Array, fs: float, order: int, delay: float = 0.0) -> Array:
    """Return a derivative of a channel [per s^order], delayed [s]; 2 HALF samples shorter than `x`."""
    return np.asarray(apply_each(stencil(delay * fs, order)[None] * fs**order, x)[0])


def reached(masked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which outputs of a stencil masked samples reach; 2 HALF samples shorter."""
    if not masked.any():
        return np.zeros(max(masked.size - 2 * HALF, 0), dtype=bool)
    return apply(np.ones(2 * HALF + 1), masked.astype(float)) > 0.5


def bridge(x: Array, fs: float) -> tuple[Array, NDArray[np.bool_]]:
    """Interpolate missing samples (NaN) and tell which stretches are too long to believe it.

    Returns
    -------
    filled : ndarray, shape (N,)
        `x` with a cubic spline through the short gaps and straight lines through the others.
    masked : ndarray of bool, shape (N,)
        True in stretches longer than BRIDGE.
    """
    missing = np.isnan(x)
    if not missing.any():
        return x, missing
    if np.count_nonzero(~missing) < 2:
        return np.zeros_like(x), np.ones_like(missing)
    masked = np.zeros_like(missing)
    for start, stop in stretches(missing):
        masked[start:stop] = stop - start > max(1.0, BRIDGE * fs)
    n, short = np.arange(x.size), missing & ~masked
    filled = x.copy()
    filled[masked] = np.interp(n[masked], n[~missing], x[~missing])
    if short.any():
        filled[short] = scipy.interpolate.CubicSpline(n[~missing], x[~missing])(n[short])
    return filled, masked


def stretches(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return first index and end of every run of True, shape (number of runs, 2)."""
    return stretches_of([flags])


def stretches_of(parts: Iterable[NDArray[np.bool_]]) -> NDArray[np.intp]:
    """Return what `stretches` does of flags that come part by part."""
    edges, start, last = [np.zeros(0, dtype=np.intp)], 0, np.zeros(1, dtype=bool)
    for flags in (part for part in parts if part.size):
        edges.append(start + np.flatnonzero(np.diff(flags, prepend=last)))
        start, last = start + flags.size, flags[-1:]
    edges.append(np.full(int(last[0]), start))
    return np.concatenate(edges).reshape(-1, 2)


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
    taps = windows.low_pass(2 * half + 1, (f_max + width / 2) / fs, RIPPLE)
    taps.flags.writeable = False  # others get the same ones
    return taps, factor


def decimate(x: Array, taps: Array, factor: int) -> Array:
    """Filter and keep every factor-th sample, the first at index ``taps.size // 2`` of `x`.

    What `low_pass` leaves as it is comes back as it is.
    """
    if factor == 1:
        return x
    lost = taps.size - 1  # a multiple of factor
    n = (x.size - 1 - lost) // factor + 1
    if n < 1:
        return np.empty(0)
    # an output is a sum of products of `factor` samples in a row with as many taps: one product of matrices
    rows = x[: (n - 1) * factor + lost].reshape(-1, factor)
    of_rows = taps[:0:-1].reshape(-1, factor) @ rows.T
    found: Array = taps[0] * x[lost::factor][:n]
    for k, row in enumerate(of_rows):
        found += row[k : k + n]
    return found


def decimated(x: Row, taps: Array, factor: int) -> Array:
    """Filter and decimate a channel as `decimate` does; a missing sample counts as zero."""
    kept = [decimate(np.nan_to_num(x[piece]), taps, factor) for piece in _parts(x, taps, factor)]
    return np.concatenate([np.empty(0), *kept])


def _parts(x: Row, taps: Array, factor: int) -> Iterator[slice]:
    """Yield slices of a channel that, decimated one by one, make what it makes as a whole, bit by bit."""
    return pieces(x.size, taps.size - 1, PIECE // factor * factor)


def reduced(
    x: Row, fs: float, taps: Array, factor: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Bridge, filter and decimate a channel, shape (N,).

    Returns
    -------
    kept : ndarray, shape (M,)
        What is left of it.
    touched : ndarray of bool, shape (M,)
        True where the longer gaps reach.
    missing : ndarray of bool, shape (N,), or (1,)
        True where samples are missing; one False for all if none is.
    """
    kept = []
    for piece in _parts(x, taps, factor):
        part = x[piece]
        if np.isnan(part).any():
            return _bridged(x[:], fs, taps, factor)
        kept.append(decimate(part, taps, factor))
    found = np.concatenate([np.empty(0), *kept])
    return found, np.zeros(found.size, dtype=bool), np.zeros(1, dtype=bool)


def _bridged(
    x: Array, fs: float, taps: Array, factor: int
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return what `reduced` does of a channel that misses samples."""
    filled, masked = bridge(x, fs)
    kept = decimate(filled, taps, factor)
    if not masked.any():
        return kept, np.zeros(kept.size, dtype=bool), np.isnan(x)
    return kept, decimate(masked.astype(float), np.ones_like(taps), factor) > 0.5, np.isnan(x)
