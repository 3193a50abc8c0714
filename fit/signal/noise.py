"""The smooth PSD of noise, fitted to a periodogram by likelihood: what weighs the data."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.threads import kept

Array = NDArray[np.float64]

KNOTS_PER_DECADE = 10
BINS_PER_KNOT = 12


@dataclass(frozen=True)
class Basis:
    """How log S at B ascending frequencies follows from its K values at the knots: a matrix, shape (B, K).

    Between two knots it is a cubic, so that four numbers for every frequency stand for the K of its row: of
    weeks, the matrix fills the memory.

    Attributes
    ----------
    starts, counts : ndarray of int, shape (C,)
        First of the frequencies on every cubic that has some, and how many there are.
    powers : ndarray, shape (4, B)
        What multiplies the four coefficients of its cubic at every frequency.
    coefficients : ndarray, shape (4, C, K)
        Those of the cubics for the values at the knots.
    """

    starts: NDArray[np.intp]
    counts: NDArray[np.intp]
    powers: Array
    coefficients: Array

    def __matmul__(self, values: Array) -> Array:
        """Return log S, shape (B,), of values at the knots."""
        return np.asarray(np.einsum("pb,pb->b", self.powers, self._spread(self.coefficients @ values)))

    def summed(self, x: Array) -> Array:
        """Return the product of the transpose with x, shape (B,)."""
        return np.asarray(np.einsum("pck,pc->k", self.coefficients, self._by_cubic(self.powers * x)))

    def products(self, weights: Array) -> Array:
        """Return the weighted products of the columns with each other, shape (K, K)."""
        found = np.zeros((self.coefficients.shape[2],) * 2)
        for of, power in zip(self.coefficients, self.powers, strict=True):
            sums = self._by_cubic(self.powers * (power * weights))
            found += of.T @ np.einsum("pck,pc->ck", self.coefficients, sums)
        return found

    @cached_property
    def squares(self) -> Array:
        """The products of the columns with each other, shape (K, K)."""
        return self.products(np.ones(self.powers.shape[1]))

    def variance(self, covariance: Array) -> Array:
        """Return the variance of log S, shape (B,), for values of some covariance."""
        of_cubics = np.einsum("ick,jck->ijc", self.coefficients @ covariance, self.coefficients)
        along = np.array([np.einsum("pb,pb->b", self.powers, self._spread(of)) for of in of_cubics])
        return np.asarray(np.einsum("pb,pb->b", self.powers, along))

    def _spread(self, of_cubics: Array) -> Array:
        """Return for every frequency what is of its cubic, shape (P, B), of shape (P, C)."""
        return np.repeat(of_cubics, self.counts, axis=1)

    def _by_cubic(self, x: Array) -> Array:
        """Return the sums over the frequencies on every cubic, shape (P, C), of x, shape (P, B)."""
        return np.asarray(np.add.reduceat(x, self.starts, axis=1))


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
    below : int
        How many bins below the first knot took part.
    dropped : int
        How many times in an iteration they took part no longer.
    """

    knots: Array
    values: Array
    covariance: Array
    below: int = 0
    dropped: int = 0

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

    def beside(self, f: Array, power: Array) -> Array:
        """Return S at the frequencies `f` it was fitted at, shape (B,), without what each bin told of itself.

        To first order, from its leverage in the fit to `power`, shape (B,), with dof 1. What weighs a bin by
        S would know its noise otherwise.
        """
        S, basis = self(f), self.basis(f)
        return np.asarray(S * np.exp(-basis.variance(self.covariance) * (power / S - 1)))


@kept(12)  # the runs of a campaign have few lengths, and each is asked for again and again
def _basis(of_knots: bytes, of_f: bytes) -> Basis:
    """Return the basis of natural splines with these knots, straight beyond them."""
    knots, u = np.frombuffer(of_knots), np.log(np.frombuffer(of_f))
    inside = np.clip(u, knots[0], knots[-1])
    cubic = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, knots.size - 2)
    t, beyond = inside - knots[cubic], u - inside
    powers = np.stack([t**3 + 3 * t**2 * beyond, t**2 + 2 * t * beyond, t + beyond, np.ones_like(t)])
    spline = scipy.interpolate.CubicSpline(knots, np.eye(knots.size), bc_type="natural")
    there, starts, counts = np.unique(cubic, return_index=True, return_counts=True)
    return Basis(starts, counts, powers, np.asarray(spline.c[:, there], dtype=np.float64))


@kept(8)
def _knots(of_f: bytes) -> Array:
    """Space the knots evenly in log f, but never closer than BINS_PER_KNOT bins."""
    f, bins = np.frombuffer(of_f), [0.0]
    while bins[-1] < f.size - 1:
        bins.append(bins[-1] + max(BINS_PER_KNOT, (bins[-1] + 1) * (10 ** (1 / KNOTS_PER_DECADE) - 1)))
    short = f.size - 1 - bins[-2] < 0.5 * (bins[-1] - bins[-2])
    bins[-2 if short else -1 :] = [f.size - 1.0]
    knots = np.log(np.interp(bins, np.arange(f.size), f))
    knots.setflags(write=False)
    return knots


def fit_noise(f: Array, power: Array, dof: Array, below: int = 0) -> NoiseModel:
    """Fit a noise model to a periodogram by maximum (Whittle) likelihood.

    Minimises ``sum dof log S + power / S``, convex in the logarithms; Fisher scoring.

    Parameters
    ----------
    f, power : ndarray, shape (B,)
        Frequencies [Hz] and periodogram.
    dof : ndarray, shape (B,)
        Expected power over S: 1, less what a fit has already taken out of the bin.
    below : int
        How many of the first bins lie below the first knot.

    Raises
    ------
    FitError
        If there is no noise, or the iteration does not settle.
    """
    level = float(np.mean(power))
    if not (math.isfinite(level) and level > 0):
        raise FitError("the residual carries no noise whose PSD could weigh the data")
    knots = _knots(f[below:].tobytes())
    basis = _basis(knots.tobytes(), f.tobytes())
    start = np.log(np.maximum(power, 1e-30 * level)) + np.euler_gamma
    values = np.asarray(np.linalg.solve(basis.squares, basis.summed(start)), dtype=np.float64)
    fisher = basis.products(dof)

    def cost(v: Array) -> tuple[float, Array]:
        """Return the cost and ``power / S``."""
        log_S = basis @ v
        with np.errstate(over="ignore"):  # a step too far costs infinitely much
            relative = power * np.exp(-log_S)
            return float(dof @ log_S + np.sum(relative)), relative

    last, relative = cost(values)
    for _ in range(100):
        step = np.asarray(np.linalg.solve(fisher, basis.summed(relative - dof)), dtype=np.float64)
        size, previous = 1.0, last
        last, relative = cost(values + step)
        while last > previous and size > 1e-6:
            size /= 2
            last, relative = cost(values + size * step)
        values = values + size * step
        if abs(previous - last) < 1e-9 * f.size:
            return NoiseModel(knots, values, np.asarray(np.linalg.inv(fisher)), below)
    raise FitError("the smooth PSD of the noise did not converge")
