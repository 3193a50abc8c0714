"""Fits with random effects, averaged over their widths: the posterior of parameters and widths.

At given widths everything is linear and Gaussian: the posterior of the parameters is a normal distribution,
and the data say of the widths what `restricted_likelihood` returns. Each width gets a half-Cauchy prior about
zero, and the posterior of the parameters is the mean of the normal distributions over that of the widths:
exact but for the sum over a grid in place of the integral.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting.constraints import at_bound
from fit.fitting.irls import IRLSResult, solution
from fit.fitting.joint_model import free_directions, parameter_values, prior_rows, varying
from fit.fitting.random_effects import RANDOM_EFFECTS, ScaleParameter, restricted_likelihood

Array = NDArray[np.float64]

LARGEST, SMALLEST = 100.0, 1e-6  # widths, in scales of their prior, between which the grid lies
STEP = 0.25  # in the logarithm, by which the ends of the grid are searched for
MAX_DROP = 16.0  # of the log density at the ends of the grid
NEGLIGIBLE = 1e-8  # density relative to the largest, below which a point of the grid does not count
POINTS = (81, 31)  # of the grid along each axis, by the number of widths


@dataclass(frozen=True)
class NormalEquations:
    """Information on parameters theta, shape (P,), from data and priors, those of deviations left out.

    Attributes
    ----------
    H : ndarray, shape (P, P)
        Information.
    b : ndarray, shape (P,)
        Score at the origin: the log density is ``b' x - x' H x / 2`` for ``x = theta - origin``.
    origin : ndarray, shape (P,)
        A point with zero deviations.
    """

    H: Array
    b: Array
    origin: Array

    def about_zero(self, members: Sequence[int]) -> NormalEquations:
        """Return the equations about a point at which some parameters are zero."""
        shift = np.zeros_like(self.origin)
        shift[list(members)] = self.origin[list(members)]
        return NormalEquations(self.H, self.b + self.H @ shift, self.origin - shift)


@dataclass(frozen=True)
class WidthPosterior:
    """The posterior of parameters and widths.

    Attributes
    ----------
    mean, covariance : ndarray, shapes (P,) and (P, P)
        Of the parameters.
    widths, sigmas : ndarray, shape (W,)
        Mean and standard deviation of each width.
    log_widths, log_sigmas : ndarray, shape (W,)
        Mean and standard deviation of their logarithms.
    """

    mean: Array
    covariance: Array
    widths: Array
    sigmas: Array
    log_widths: Array
    log_sigmas: Array


def conditional(
    equations: NormalEquations, widths: Sequence[ScaleParameter], log_widths: Array
) -> tuple[float, Array, Array]:
    """Return the posterior at fixed logarithms of the W widths, shape (W,).

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
    scale = 1 / np.sqrt(np.maximum(np.diag(equations.H), 1e-300))
    prior = np.zeros(scale.size)
    for width, log_width in zip(widths, log_widths, strict=True):
        scale[list(width.members)] = np.exp(log_width) * width.units
        prior[list(width.members)] = 1.0
    try:  # the scales of the shared parameters, and their part of the determinant, are the same at all widths
        density, root, y = restricted_likelihood(equations.H, equations.b, scale, prior)
    except np.linalg.LinAlgError as error:
        raise FitError("the data and the deviations leave a direction free") from error
    density += float(sum(w.log_prior(x) for w, x in zip(widths, log_widths, strict=True)))
    return density, equations.origin + root @ y, root @ root.T


def marginalise(equations: NormalEquations, widths: Sequence[ScaleParameter]) -> WidthPosterior:
    """Return the posterior of parameters and widths: a sum of normal distributions over a grid of widths.

    Raises
    ------
    FitError
        If a direction stays free.
    """
    points = np.array(list(product(*_axes(equations, widths))))
    density = np.array([conditional(equations, widths, point)[0] for point in points])
    weight = np.exp(density - density.max())
    weight[weight < NEGLIGIBLE] = 0.0
    weight /= weight.sum()
    mean, square = np.zeros(equations.origin.size), np.zeros_like(equations.H)
    for point, w in zip(points[weight > 0], weight[weight > 0], strict=True):
        _, theta, covariance = conditional(equations, widths, point)
        mean += w * (theta - equations.origin)
        square += w * (covariance + np.outer(theta - equations.origin, theta - equations.origin))
    s, x = weight @ np.exp(points), weight @ points
    return WidthPosterior(
        equations.origin + mean,
        square - np.outer(mean, mean),
        s,
        np.sqrt(weight @ np.exp(2 * points) - s**2),
        x,
        np.sqrt(weight @ (points - x) ** 2),
    )


def _axes(equations: NormalEquations, widths: Sequence[ScaleParameter]) -> list[Array]:
    """Return for each width the logarithms of the grid, about the most likely ones."""
    scales = np.log([w.scale for w in widths])
    low, high = scales + np.log(SMALLEST), scales + np.log(LARGEST)

    def cost(log_widths: Array) -> float:
        return -conditional(equations, widths, np.clip(log_widths, low, high))[0]

    optimum = scipy.optimize.minimize(cost, scales, method="Nelder-Mead", options={"xatol": 1e-3})
    peak = np.clip(optimum.x, low, high)
    limit, axes = cost(peak) + MAX_DROP, []
    for i in range(len(widths)):
        ends = []
        for step, end in ((-STEP, low[i]), (STEP, high[i])):
            point = peak.copy()
            while step * (end - point[i]) > 0 and cost(point) < limit:
                point[i] += step
            ends.append(point[i])
        axes.append(np.linspace(ends[0], ends[1], POINTS[len(widths) - 1]))
    return axes


def marginalise_widths(outcome: IRLSResult) -> IRLSResult:
    """Return a fit with deviations, averaged over their widths.

    Estimates that are at a bound where the widths are the likeliest ones stay there.

    Raises
    ------
    FitError
        If the data leave a direction free.
    """
    model, params, widths = outcome.model, outcome.result.params.copy(), outcome.random_effects
    theta, ordered, places = outcome.solution.theta, list(params.values()), varying(params)
    for i in (i for width in widths for i in width.members):
        ordered[i].user_data = None
    free, (rows, centre) = free_directions(params), prior_rows(params)
    information = model.information(params)
    equations = NormalEquations(
        free.T @ (information + rows.T @ rows) @ free,
        -free.T @ (model.score(params) + rows.T @ (rows @ theta - centre)),
        theta[places],
    )
    of_free = [replace(w, members=tuple(map(places.index, w.members))) for w in widths]
    equations = equations.about_zero([i for width in of_free for i in width.members])
    posterior = marginalise(equations, of_free)
    for width, log_width in zip(widths, posterior.log_widths, strict=True):
        for i, prior in width.priors(np.exp(log_width)).items():
            ordered[i].user_data = prior
    result = model.fit(params)
    mean, covariance = theta + free @ (posterior.mean - theta[places]), free @ posterior.covariance @ free.T
    if bounded := [*at_bound(result.params, np.sqrt(np.diag(covariance)))]:
        C, bound = covariance[:, bounded], parameter_values(result.params)[bounded]
        mean = mean + C @ np.linalg.solve(C[bounded], bound - mean[bounded])
    likeliest = free @ conditional(equations, of_free, posterior.log_widths)[2] @ free.T
    n_determined = float(np.trace(likeliest @ information))
    psd_error = likeliest @ model.psd_scores(params) @ likeliest
    return replace(
        outcome,
        solution=solution(outcome.whitened_runs, mean, covariance + psd_error, n_determined),
        scatter=_scatter(outcome, posterior),
        log_widths=tuple(zip(posterior.log_widths.tolist(), posterior.log_sigmas.tolist(), strict=True)),
        result=result,
    )


def _scatter(outcome: IRLSResult, posterior: WidthPosterior) -> dict[str, tuple[float, float]]:
    """Return the width and its sigma for every parameter that deviates, in its unit."""
    scatter = {}
    for width, value, sigma in zip(outcome.random_effects, posterior.widths, posterior.sigmas, strict=True):
        effect = next(effect for effect in RANDOM_EFFECTS if effect.name == width.name)
        for i, unit in zip(width.members, width.units.tolist(), strict=True):
            deviation = outcome.parameters[i].name
            name = next(name for name in effect.parameters if deviation.startswith(f"d{name}_"))
            scatter[name] = (float(value * unit), float(sigma * unit))
    return scatter
