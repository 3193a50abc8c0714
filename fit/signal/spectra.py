"""From sampled channels to whitened spectra: low-pass, exact stencils, window, transform, noise PSD.

Everything that differentiates or delays acts in the time domain on unwindowed data; (i omega)^2 applied to
windowed data would turn the slope of the window into signal. Only then comes the window, and the transform.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

F_MAX = 0.1  # Hz, end of the fitted band; archives at 1 Hz are flat up to here
RATE = 1.0  # Hz, least rate after decimation
HALF = 10  # samples on either side of a stencil: gain right to 1e-10 below F_MAX at 1 Hz
RIPPLE = 100.0  # dB, what the low-pass leaves of what would alias into the band
TAPER = 0.1  # fraction of the run under the two cosine flanks of the window
GAP_TAPER = 60.0  # s, flank beside a masked stretch
BRIDGE = 1.0  # s, longest stretch of missing samples that is interpolated rather than masked
KNOTS_PER_DECADE = 10
BINS_PER_KNOT = 12


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
    return np.linalg.solve(nodes ** powers[:, None], np.array(moments) / HALF**order)


def apply(weights: Array, x: Array) -> Array:
    """Return ``sum_k weights[k] x[n + k]`` wherever the stencil fits; 2 HALF samples shorter than `x`."""
    return np.correlate(x, weights, mode="valid")


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
    edges = np.diff(flags.astype(np.int8), prepend=0, append=0)
    return np.stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)], axis=1)


def low_pass(fs: float) -> tuple[Array, int]:
    """Return the taps of the common zero-phase filter and the decimation it makes safe, 1 below 2 Hz.

    Flat to 10^(-RIPPLE/20) up to F_MAX; the same filter on every column leaves the equation as it is.
    """
    factor = max(1, math.floor(fs / RATE + 1e-9))
    if factor == 1:
        return np.ones(1), 1
    width = fs / factor - 2 * F_MAX  # from F_MAX to where aliases would reach F_MAX
    half = (RIPPLE - 7.95) / (2.285 * 2 * math.pi * width / fs) / 2
    half = factor * math.ceil(half / factor)
    window = ("kaiser", scipy.signal.kaiser_beta(RIPPLE))
    taps = scipy.signal.firwin(2 * half + 1, F_MAX + width / 2, window=window, fs=fs)
    return np.asarray(taps, dtype=np.float64), factor


def decimate(x: Array, taps: Array, factor: int) -> Array:
    """Filter and keep every factor-th sample, the first at index ``taps.size // 2`` of `x`."""
    lost = taps.size - 1  # a multiple of factor
    kept = scipy.signal.upfirdn(taps, x, down=factor)[lost // factor : (x.size - 1) // factor + 1]
    return np.asarray(kept, dtype=np.float64)


def window(valid: NDArray[np.bool_], fs: float) -> Array:
    """Return a Tukey window over the run with a smooth notch at every masked stretch, shape (N,)."""
    n = np.arange(valid.size)
    w = np.asarray(scipy.signal.windows.tukey(valid.size + 2, TAPER)[1:-1], dtype=np.float64)
    for start, stop in stretches(~valid):
        distance = np.maximum(np.maximum(start - n, n - stop + 1), 0) / (GAP_TAPER * fs)
        w *= np.sin(np.pi / 2 * np.minimum(distance, 1)) ** 2
    return w


@dataclass(frozen=True)
class Spectra:
    """Windowed columns of one run in the fitted band.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz], from the first bin up: the lowest belong to the band, see `linear`.
    columns : ndarray of complex, shape (B, P)
        Transforms of the windowed columns, scaled so that the mean of ``|.|^2`` is the one-sided PSD.
    nuisance : ndarray of complex, shape (B, 2)
        Those of a constant and a ramp, to be projected out.
    window : ndarray, shape (N,)
        The window, zero where samples are masked.
    """

    f: Array
    columns: Spectrum
    nuisance: Spectrum
    window: Array


def transform(columns: Array, valid: NDArray[np.bool_], fs: float) -> Spectra:
    """Window and transform columns, shape (N, P), of sample rate `fs`.

    Of the end of the run up to 0.5 % is left out, for a length that transforms fast.
    """
    n = scipy.fft.prev_fast_len(len(columns))
    w = window(valid[:n], fs)
    bins = slice(1, math.floor(min(F_MAX, fs / 10) * n / fs) + 1)
    scale = math.sqrt(2 / (fs * float(w @ w)))
    ramp = np.stack([np.ones(n), np.linspace(-1, 1, n)], axis=1)

    def spectrum(x: Array) -> Spectrum:
        return np.asarray(scipy.fft.rfft(w[:, None] * x[:n], axis=0)[bins] * scale, dtype=np.complex128)

    return Spectra(np.arange(n // 2 + 1)[bins] * fs / n, spectrum(columns), spectrum(ramp), w)


@dataclass(frozen=True)
class NoiseModel:
    """Smooth one-sided PSD: a natural cubic spline of log S in log f, straight beyond its ends.

    Attributes
    ----------
    knots : ndarray, shape (K,)
        log(f / Hz).
    values : ndarray, shape (K,)
        log S at the knots.
    covariance : ndarray, shape (K, K)
        Of `values`.
    """

    knots: Array
    values: Array
    covariance: Array

    def __call__(self, f: Array) -> Array:
        """Return S at the frequencies `f`, shape (B,)."""
        return np.asarray(np.exp(_spline_basis(self.knots, f) @ self.values), dtype=np.float64)

    def expected(self, f: Array) -> Array:
        """Return the power to expect at the frequencies `f`, shape (B,), knowing S only as well as we do.

        An estimate of variance v of log S is as often too low by a factor as too high, which makes the mean
        of the true S larger than the estimate by e^v. Hardly known bins lose their weight that way.
        """
        basis = _spline_basis(self.knots, f)
        variance = np.sum((basis @ self.covariance) * basis, axis=1)
        return np.asarray(np.exp(basis @ self.values + variance), dtype=np.float64)


def _spline_basis(knots: Array, f: Array) -> Array:
    return _basis(knots.tobytes(), f.tobytes())


@lru_cache(maxsize=8)  # the runs of a campaign have few lengths, and each is asked for again and again
def _basis(of_knots: bytes, of_f: bytes) -> Array:
    knots, f = np.frombuffer(of_knots), np.frombuffer(of_f)
    spline = scipy.interpolate.CubicSpline(knots, np.eye(knots.size), bc_type="natural")
    u = np.log(f)
    inside = np.clip(u, knots[0], knots[-1])
    basis = np.asarray(spline(inside) + spline(inside, 1) * (u - inside)[:, None], dtype=np.float64)
    basis.setflags(write=False)
    return basis


def _knots(f: Array) -> Array:
    """Space the knots evenly in log f, but never closer than BINS_PER_KNOT bins."""
    bins = [0.0]
    while bins[-1] < f.size - 1:
        bins.append(bins[-1] + max(BINS_PER_KNOT, (bins[-1] + 1) * (10 ** (1 / KNOTS_PER_DECADE) - 1)))
    short = f.size - 1 - bins[-2] < 0.5 * (bins[-1] - bins[-2])
    bins[-2 if short else -1 :] = [f.size - 1.0]
    return np.log(np.interp(bins, np.arange(f.size), f))


def fit_noise(f: Array, power: Array, dof: Array) -> NoiseModel:
    """Fit a noise model to a periodogram by maximum (Whittle) likelihood.

    Minimises ``sum dof log S + power / S``, convex in the logarithms; Fisher scoring.

    Parameters
    ----------
    f, power : ndarray, shape (B,)
        Frequencies [Hz] and periodogram.
    dof : ndarray, shape (B,)
        Expected power over S: 1, less what a fit has already taken out of the bin.

    Raises
    ------
    FitError
        If there is no noise, or the iteration does not settle.
    """
    level = float(np.mean(power))
    if not (math.isfinite(level) and level > 0):
        raise FitError("the residual carries no noise whose PSD could weigh the data")
    knots = _knots(f)
    basis = _spline_basis(knots, f)
    start = np.log(np.maximum(power, 1e-30 * level)) + np.euler_gamma
    values = np.asarray(np.linalg.lstsq(basis, start)[0], dtype=np.float64)
    fisher: Array = (basis * dof[:, None]).T @ basis

    def cost(v: Array) -> float:
        with np.errstate(over="ignore"):  # a step too far costs infinitely much
            return float(dof @ (basis @ v) + np.sum(power * np.exp(-basis @ v)))

    last = cost(values)
    for _ in range(100):
        gradient = basis.T @ (power * np.exp(-basis @ values) - dof)
        step = np.asarray(np.linalg.solve(fisher, gradient), dtype=np.float64)
        size = 1.0
        while cost(values + size * step) > last and size > 1e-6:
            size /= 2
        values = values + size * step
        previous, last = last, cost(values)
        if abs(previous - last) < 1e-9 * f.size:
            return NoiseModel(knots, values, np.asarray(np.linalg.inv(fisher)))
    raise FitError("the smooth PSD of the noise did not converge")
