"""Linear parameters about a common value, by widths that are not known: the posterior of both.

Given the widths, everything is linear and Gaussian: the posterior of the parameters is a normal distribution,
and what the data say of the widths is a determinant and a quadratic form,

    log L(w) = log N(w) = -1/2 log det(1 + W A W) + 1/2 b' W (1 + W A W)^-1 W b + const

with A and b information and score of the departures, all else projected out, and W their widths. The widths
get a half-Cauchy prior about zero each, and the posterior of the parameters is the mean of the normal
distributions over that of the widths: exact but for the sum over a grid that stands for the integral.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError

Array = NDArray[np.float64]

LARGEST, SMALLEST = 100.0, 1e-6  # widths, in scales of their prior, between which the grid lies
STEP = 0.25  # in the logarithm, by which the ends of the grid are looked for
MAX_DROP = 16.0  # by which the logarithm of the density has fallen there
NEGLIGIBLE = 1e-8  # share of the density at the most likely widths, from which a point does not count
POINTS = (81, 31, 15, 9)  # of the grid along each axis, by the number of widths


@dataclass(frozen=True)
class NormalEquations:
    """What data and priors say of parameters theta, the widths of their departures left out.

    Attributes
    ----------
    H : ndarray, shape (P, P)
        Information.
    b : ndarray, shape (P,)
        Score at `origin`: the logarithm of the density is ``b' x - x' H x / 2`` for ``x = theta - at``.
    origin : ndarray, shape (P,)
        A point, zero where departures stand.
    """

    H: Array
    b: Array
    origin: Array


@dataclass(frozen=True)
class ScaleParameter:
    """A width that departures have in common.

    Attributes
    ----------
    name : str
        What departs.
    members : tuple of int
        Where its departures stand among the parameters.
    units : ndarray, shape (len(members),)
        What the width is multiplied by for each of them.
    scale : float
        Of its half-Cauchy prior: as often below it as above.
    """

    name: str
    members: tuple[int, ...]
    units: Array
    scale: float

    def log_prior(self, log_width: Array) -> Array:
        """Return the logarithm of the prior density of the logarithm of the width."""
        x = log_width - np.log(self.scale)
        return np.asarray(np.log(2 / np.pi) + x - np.log1p(np.exp(2 * x)))


@dataclass(frozen=True)
class WidthPosterior:
    """The posterior of parameters and widths.

    Attributes
    ----------
    mean, covariance : ndarray, shapes (P,) and (P, P)
        Of the parameters.
    widths : ndarray, shape (W,)
        Mean of each width.
    sigmas : ndarray, shape (W,)
        Standard deviation of each width.
    log_widths, log_sigmas : ndarray, shape (W,)
        Mean and standard deviation of their logarithms.
    """

    mean: Array
    covariance: Array
    widths: Array
    sigmas: Array
    log_widths: Array
    log_sigmas: Array


def n_shared(widths: Sequence[ScaleParameter], n_parameters: int) -> int:
    """Return the number of parameters that are no departures; they come first."""
    return min((min(width.members) for width in widths), default=n_parameters)


def conditional(
    normal: NormalEquations, widths: Sequence[ScaleParameter], log_widths: Array
) -> tuple[float, Array, Array]:
    """Return what is known given the widths.

    Parameters
    ----------
    normal : Normal
        What data say.
    widths : sequence of ScaleParameter
        The W widths.
    log_widths : ndarray, shape (W,)
        Their logarithms.

    Returns
    -------
    density : float
        Logarithm of the density of the logarithms of the widths, but for a constant.
    mean, covariance : ndarray, shapes (P,) and (P, P)
        Of the parameters.

    Raises
    ------
    FitError
        If a direction stays free.
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(normal.H), 1e-300))
    prior = np.zeros(scale.size)
    for width, log_width in zip(widths, log_widths, strict=True):
        scale[list(width.members)] = np.exp(log_width) * width.units
        prior[list(width.members)] = 1.0
    A = scale[:, None] * normal.H * scale + np.diag(prior)
    try:
        root = np.linalg.cholesky(A)
    except np.linalg.LinAlgError as error:
        raise FitError("the data leave a direction free beside what departs") from error
    inverse = scipy.linalg.solve_triangular(root, np.eye(scale.size), lower=True)
    y = inverse @ (scale * normal.b)
    # of what does not depart the scales are the same for all widths, and so is their part of the determinant
    density = -float(np.sum(np.log(np.diag(root)))) + float(y @ y) / 2
    density += float(sum(w.log_prior(x) for w, x in zip(widths, log_widths, strict=True)))
    to_theta = scale[:, None] * inverse.T
    return density, normal.origin + to_theta @ y, to_theta @ to_theta.T


def marginalise(normal: NormalEquations, widths: Sequence[ScaleParameter]) -> WidthPosterior:
    """Return the posterior of parameters and widths.

    Raises
    ------
    FitError
        If a direction stays free, or no most likely widths are found.
    """
    points = np.array(list(product(*_axes(normal, widths))))
    density = np.array([conditional(normal, widths, point)[0] for point in points])
    weight = np.exp(density - density.max())
    weight[weight < NEGLIGIBLE] = 0.0
    weight /= weight.sum()
    mean, square = np.zeros(normal.origin.size), np.zeros_like(normal.H)
    for point, w in zip(points[weight > 0], weight[weight > 0], strict=True):
        _, conditional_mean, covariance = conditional(normal, widths, point)
        mean += w * (conditional_mean - normal.origin)
        square += w * (
            covariance + np.outer(conditional_mean - normal.origin, conditional_mean - normal.origin)
        )
    s, x = weight @ np.exp(points), weight @ points
    return WidthPosterior(
        normal.origin + mean,
        square - np.outer(mean, mean),
        s,
        np.sqrt(weight @ np.exp(2 * points) - s**2),
        x,
        np.sqrt(weight @ (points - x) ** 2),
    )


def _axes(normal: NormalEquations, widths: Sequence[ScaleParameter]) -> list[Array]:
    """Return for each width the logarithms that the grid has, about the most likely ones."""

    def density(log_widths: Array) -> float:
        return conditional(normal, widths, log_widths)[0]

    scales = np.log([w.scale for w in widths])
    low, high = scales + np.log(SMALLEST), scales + np.log(LARGEST)

    def cost(x: Array) -> float:
        return -density(np.clip(x, low, high))

    optimum = scipy.optimize.minimize(cost, scales, method="Nelder-Mead", options={"xatol": 1e-3})
    peak = np.clip(optimum.x, low, high)
    top, axes = density(peak), []
    for i in range(len(widths)):
        ends = []
        for step, end in ((-STEP, low[i]), (STEP, high[i])):
            point = peak.copy()
            while step * (end - point[i]) > 0 and density(point) > top - MAX_DROP:
                point[i] += step
            ends.append(point[i])
        axes.append(np.linspace(ends[0], ends[1], POINTS[len(widths) - 1]))
    return axes
