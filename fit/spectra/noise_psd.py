"""The smooth PSD of noise, fitted to a periodogram by likelihood: what weighs the data."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError

Array = NDArray[np.float64]

KNOTS_PER_DECADE = 10
BINS_PER_KNOT = 12
MAX_STEP = 1.0  # in log S, up to which a known PSD serves as the initial one
MAX_ITERATIONS = 300  # short series with next to no data at the lowest knot take more than a hundred


@dataclass(frozen=True)
class Basis:
    """How log S at B frequencies follows from its K values at the knots: a matrix of shape (B, K).

    Between two knots it is a cubic, so that one number for every frequency stands for the K of its row: of
    weeks, the matrix fills the memory.

    Attributes
    ----------
    t : ndarray, shape (B,)
        How far a frequency is beyond the knot where its cubic begins.
    starts, counts : ndarray of int, shape (S,)
        The first of the frequencies of every cubic, and how many it has.
    coefficients : ndarray, shape (4, S, K)
        Those of every cubic for the values at the knots, the constant first.
    """

    t: Array
    starts: NDArray[np.intp]
    counts: NDArray[np.intp]
    coefficients: Array

    def __matmul__(self, values: Array) -> Array:
        """Return log S, shape (B,), of values at the knots."""
        return self._polynomial(self.coefficients @ values)

    def summed(self, x: Array) -> Array:
        """Return the product of x, shape (..., B), with the matrix, shape (..., K)."""
        moments = self._moments(x, 4)
        return np.asarray(np.tensordot(moments, self.coefficients, axes=([0, -1], [0, 1])), dtype=np.float64)

    def products(self, weights: Array) -> Array:
        """Return the weighted products of the columns with each other, shape (K, K)."""
        moments = self._moments(weights, 7)[_SUMS]
        inner = np.einsum("ijs,jsk->isk", moments, self.coefficients)
        return np.asarray(np.tensordot(self.coefficients, inner, axes=([0, 1], [0, 1])), dtype=np.float64)

    @cached_property
    def squares(self) -> Array:
        """The products of the columns with each other, shape (K, K)."""
        return self.products(np.ones(self.t.size))

    def variance(self, covariance: Array) -> Array:
        """Return the variance of log S, shape (B,), for values of some covariance."""
        cubics = self.coefficients.transpose(1, 0, 2)
        pairs = cubics @ covariance @ cubics.transpose(0, 2, 1)
        coefficients = np.zeros((7, len(pairs)))
        np.add.at(coefficients, _SUMS, pairs.transpose(1, 2, 0))
        return self._polynomial(coefficients)

    def _polynomial(self, coefficients: Array) -> Array:
        """Return polynomials in `t`, one for every cubic, shape (B,)."""
        *lower, highest = coefficients
        value: Array = highest.repeat(self.counts)
        for coefficient in lower[::-1]:
            value *= self.t
            value += coefficient.repeat(self.counts)
        return value

    def _moments(self, x: Array, number: int) -> Array:
        """Return for every cubic the sums of x, shape (..., B), times powers of `t`: (number, ..., S)."""
        moments = np.empty((number, *x.shape[:-1], self.starts.size))
        for moment in moments:
            np.add.reduceat(x, self.starts, axis=-1, out=moment)
            x = x * self.t
        return moments


_SUMS = np.add.outer(np.arange(4), np.arange(4))  # of the powers of two cubics


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
    n_below : int
        Number of bins below the first knot that took part.
    n_dropped : int
        How many times in an iteration they took part no longer.
    """

    knots: Array
    values: Array
    covariance: Array
    n_below: int = 0
    n_dropped: int = 0

    def __call__(self, f: Array) -> Array:
        """Return S at the frequencies `f`, shape (B,)."""
        return np.asarray(np.exp(self.basis(f) @ self.values), dtype=np.float64)

    def basis(self, f: Array) -> Basis:
        """Return the derivatives of log S at the frequencies `f` by the knots, shape (B, K)."""
        return _basis(self.knots.tobytes(), f.tobytes())

    def expected(self, f: Array) -> Array:
        """Return the power to expect at the frequencies `f`, shape (B,), knowing S only as well as we do.

        An estimate of variance v of log S is as often too low by a factor as too high, which makes the mean
        of the true S larger than the estimate by e^v. Hardly known bins lose their weight that way.
        """
        basis = self.basis(f)
        return np.asarray(np.exp(basis @ self.values + basis.variance(self.covariance)), dtype=np.float64)

    def leave_one_out(self, f: Array, power: Array) -> Array:
        """Return S at the frequencies `f` it was fitted at, shape (B,), each without its own bin.

        To first order, from its leverage in the fit to `power`, shape (B,), with dof 1. Otherwise
        the weight of a bin would depend on its noise.
        """
        S, basis = self(f), self.basis(f)
        return np.asarray(S * np.exp(-basis.variance(self.covariance) * (power / S - 1)))


@lru_cache(maxsize=12)  # the runs of a campaign have few lengths, and each is asked for again and again
def _basis(knot_bytes: bytes, f_bytes: bytes) -> Basis:
    """Return the basis of natural splines with these knots, straight beyond them."""
    knots, u = np.frombuffer(knot_bytes), np.log(np.frombuffer(f_bytes))
    spline = scipy.interpolate.CubicSpline(knots, np.eye(knots.size), bc_type="natural")
    coefficients = np.zeros((4, knots.size + 1, knots.size))
    coefficients[:, 1:-1] = spline.c[::-1]
    for end, knot in ((0, knots[0]), (-1, knots[-1])):
        coefficients[:2, end] = spline(knot), spline(knot, 1)
    cubic = np.searchsorted(knots, u, side="right")
    starts = np.flatnonzero(np.diff(cubic, prepend=-1))
    counts, t = np.diff(starts, append=u.size), u - knots[np.maximum(cubic - 1, 0)]
    for shared in (t, starts, counts):
        shared.setflags(write=False)
    return Basis(t, starts, counts, np.ascontiguousarray(coefficients[:, cubic[starts]]))


@lru_cache(maxsize=8)
def _knots(f_bytes: bytes) -> Array:
    """Space the knots evenly in log f, but never closer than BINS_PER_KNOT bins."""
    f, bins = np.frombuffer(f_bytes), [0.0]
    while bins[-1] < f.size - 1:
        bins.append(bins[-1] + max(BINS_PER_KNOT, (bins[-1] + 1) * (10 ** (1 / KNOTS_PER_DECADE) - 1)))
    short = f.size - 1 - bins[-2] < 0.5 * (bins[-1] - bins[-2])
    bins[-2 if short else -1 :] = [f.size - 1.0]
    knots = np.log(np.interp(bins, np.arange(f.size), f))
    knots.setflags(write=False)
    return knots


def fit_noise(
    f: Array, power: Array, dof: Array, n_below: int = 0, initial: NoiseModel | None = None
) -> NoiseModel:
    """Fit a noise model to a periodogram by maximum (Whittle) likelihood.

    Minimises ``sum dof log S + power / S``, convex in the logarithms; Fisher scoring.

    Parameters
    ----------
    f, power : ndarray, shape (B,)
        Frequencies [Hz] and periodogram.
    dof : ndarray, shape (B,)
        Expected power over S: 1, less what a fit has already taken out of the bin.
    n_below : int
        Number of bins below the first knot.
    initial : NoiseModel, optional
        Where to begin, if it has the same knots and is not far off.

    Raises
    ------
    FitError
        If there is no noise, if a fit has taken all of it out, or if the iteration does not settle.
    """
    level = float(np.mean(power))
    if not (math.isfinite(level) and level > 0):
        raise FitError("the residual carries no noise whose PSD could weigh the data")
    knots = _knots(f[n_below:].tobytes())
    basis = _basis(knots.tobytes(), f.tobytes())
    covariance = _covariance(basis, dof)

    def cost(v: Array) -> tuple[float, Array]:
        """Return the cost and ``power / S``."""
        log_S = basis @ v
        with np.errstate(over="ignore"):  # a step too far costs infinitely much
            relative = power * np.exp(-log_S)
            return float(dof @ log_S + np.sum(relative)), relative

    def newton_step(relative: Array) -> Array:
        with np.errstate(invalid="ignore"):
            return np.asarray(covariance @ basis.summed(relative - dof), dtype=np.float64)

    warm_start = initial is not None and np.array_equal(initial.knots, knots)
    values = initial.values if initial and warm_start else _log_fit(basis, power)
    value, relative = cost(values)
    step = newton_step(relative)
    if warm_start and not np.all(np.abs(step) < MAX_STEP):
        values = _log_fit(basis, power)
        value, relative = cost(values)
        step = newton_step(relative)
    for _ in range(MAX_ITERATIONS):
        size, previous = 1.0, value
        value, relative = cost(values + step)
        while value > previous and size > 1e-6:
            size /= 2
            value, relative = cost(values + size * step)
        values = values + size * step
        if abs(previous - value) < 1e-9 * f.size:
            return NoiseModel(knots, values, covariance, n_below)
        step = newton_step(relative)
    raise FitError("the smooth PSD of the noise did not converge")


def _covariance(basis: Basis, dof: Array) -> Array:
    """Return the covariance of the values at the knots, shape (K, K)."""
    try:
        return np.asarray(np.linalg.inv(basis.products(dof)), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise FitError("the fit leaves no degrees of freedom for the PSD of the residual") from error


def _log_fit(basis: Basis, power: Array) -> Array:
    """Return the values at the knots that are closest to the logarithm of the power, shape (K,)."""
    log_power = np.log(np.maximum(power, 1e-30 * np.mean(power))) + np.euler_gamma
    return np.asarray(np.linalg.solve(basis.squares, basis.summed(log_power)), dtype=np.float64)
