"""Random effects: parameters that deviate from experiment to experiment by more than noise.

A parameter deviates in every experiment by an unknown amount, drawn from a Gaussian of unknown width w about
zero. With the information A and the score b of the deviations, all other parameters projected out, and the
diagonal matrix W of their widths, the deviations integrate out to the restricted likelihood (Patterson and
Thompson 1971; Harville 1977)

    log L(w) = -1/2 log det(1 + W A W) + 1/2 b' W (1 + W A W)^-1 W b .

`estimate_widths` maximises it: that decides whether a parameter scatters. `fit.fitting.width_posterior`
averages a fit over the widths, each with a half-Cauchy prior: that makes the sigmas of the report.

The two test masses share a width relative to the flight values, because their actuators are alike: a gain
that a single experiment determines gets the sigma that the scatter of the other gain implies. A gain that
deviates leaves the delay of the force as it is, so that C = lambda tau deviates along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from fit.fitting.joint_model import JointModel, Prior, free_directions
from fit.parameters import Parameter, joint_parameter
from fit.results import Estimate

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

FREE = 10.0  # scales of the prior of a width, within which deviations are held while weights converge
LOG_WIDTHS = np.arange(np.log(1e-7), np.log(10.0), 0.25)  # at which the likelihood is first evaluated


@dataclass(frozen=True)
class RandomEffect:
    """Parameters that deviate alike.

    Attributes
    ----------
    name : str
        In words.
    parameters : tuple of str
        The parameters, for test masses 1 and 2; the width is relative to their flight values.
    scale : float
        Of the half-Cauchy prior of the width.
    """

    name: str
    parameters: tuple[str, str]
    scale: float


# C = lambda tau, by its gain
DELAYS = {"lambda_1": "C_1", "lambda_2": "C_2", "lambda_y_1": "C_y_1", "lambda_y_2": "C_y_2"}
#: The scales are a choice: in flight lambda_2 scattered by 0.005, and C had sigmas of 0.02.
RANDOM_EFFECTS = (
    RandomEffect("gain", ("lambda_1", "lambda_2"), 0.005),
    RandomEffect("delay", ("C_1", "C_2"), 0.02),
    RandomEffect("gain along y", ("lambda_y_1", "lambda_y_2"), 0.005),
    RandomEffect("delay along y", ("C_y_1", "C_y_2"), 0.02),
)


@dataclass(frozen=True)
class ScaleParameter:
    """The width that deviations have in common.

    Attributes
    ----------
    name : str
        Of the random effect.
    members : tuple of int
        Indices of its deviations among the parameters of the fit.
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

    def priors(self, width: float) -> dict[int, Prior]:
        """Return the priors of the deviations at a width, by index of the parameter."""
        sigmas = width * np.abs(self.units)
        return {i: Prior(0.0, sigma) for i, sigma in zip(self.members, sigmas.tolist(), strict=True)}


def n_shared(widths: Sequence[ScaleParameter], n_parameters: int) -> int:
    """Return the number of parameters that are no deviations; they come first."""
    return min((min(width.members) for width in widths), default=n_parameters)


def parameters(
    names: Sequence[str], experiments: Sequence[str], start: int
) -> tuple[list[Parameter], list[ScaleParameter]]:
    """Return the deviations of every experiment, and the widths that they share.

    Parameters
    ----------
    names, experiments : sequence of str
        Parameters that deviate, and names of the experiments.
    start : int
        Index of the first deviation among the parameters of the fit.
    """
    deviations: list[Parameter] = []
    widths: list[ScaleParameter] = []
    for effect in RANDOM_EFFECTS:
        deviating = [joint_parameter(name) for name in effect.parameters if name in names]
        if not deviating:
            continue
        members = range(start + len(deviations), start + len(deviations) + len(deviating) * len(experiments))
        units = np.repeat([flight.value for flight in deviating], len(experiments))
        widths.append(ScaleParameter(effect.name, tuple(members), units, effect.scale))
        for flight in deviating:
            weak = 2 * FREE * effect.scale * flight.value  # wider than FREE: never indeterminable
            deviation = replace(flight, value=0.0, prior_sigma=weak, equation=-1)
            deviations += [replace(deviation, name=f"d{flight.name}_{e}") for e in experiments]
    return deviations, widths


def deviation_map(
    run_parameters: Sequence[str],
    names: Sequence[str],
    index: int,
    n_experiments: int,
    delays: Sequence[str] = tuple(DELAYS.values()),
) -> Array:
    """Return the map from the D deviations of all experiments to the K parameters of a run, shape (K, D).

    Parameters
    ----------
    run_parameters : sequence of str
        The parameters of the run, `names` among them.
    names : sequence of str
        Parameters that deviate.
    index, n_experiments : int
        Index of the experiment, and number of experiments.
    delays : sequence of str
        The parameters C that deviate along with their gain.
    """
    ordered = [name for effect in RANDOM_EFFECTS for name in effect.parameters if name in names]
    columns = np.zeros((len(run_parameters), len(ordered) * n_experiments))
    for i, name in enumerate(ordered):
        column = i * n_experiments + index
        columns[run_parameters.index(name), column] = 1.0
        delay = DELAYS.get(name, "")
        if delay in delays:
            columns[run_parameters.index(delay), column] = (
                joint_parameter(delay).value / joint_parameter(name).value
            )
    return columns


def restricted_likelihood(
    A: Array, b: Array, scale: Array, prior: Array | float = 1.0
) -> tuple[float, Array, Array]:
    """Return log L for information A and score b, shape (D,), of deviations of widths `scale`, shape (D,).

    Returns
    -------
    log_likelihood : float
        But for a constant.
    root : ndarray, shape (D, D)
        Of the covariance of the deviations, which is ``root @ root.T``.
    y : ndarray, shape (D,)
        Their mean is ``root @ y``, and chi^2 falls by ``y @ y``.
    """
    triangle = np.linalg.cholesky(scale[:, None] * A * scale + np.diag(np.broadcast_to(prior, scale.shape)))
    inverse = scipy.linalg.solve_triangular(triangle, np.eye(scale.size), lower=True)
    y = inverse @ (scale * b)
    log_likelihood = float(y @ y) / 2 - float(np.sum(np.log(np.diag(triangle))))
    return log_likelihood, scale[:, None] * inverse.T, y


@dataclass(frozen=True)
class WidthEstimate:
    """The widths of one or more random effects by restricted maximum likelihood.

    Attributes
    ----------
    widths : tuple of float
        Of each effect, in the unit of its columns; 0 where no scatter is more likely than any.
    log_likelihood : float
        Logarithm of the likelihood ratio to no scatter at all.
    explained : float
        By how much chi^2 falls.
    """

    widths: tuple[float, ...]
    log_likelihood: float
    explained: float

    @property
    def p(self) -> float:
        """Probability of as large a ratio without scatter: half a chi^2 of as many degrees of freedom."""
        return float(scipy.special.chdtrc(len(self.widths), 2 * max(self.log_likelihood, 0.0))) / 2


def estimate_widths(z: Array, effects: Sequence[Array]) -> WidthEstimate:
    """Maximise the restricted likelihood of the widths of deviations.

    Parameters
    ----------
    z : ndarray, shape (N,)
        Data of unit noise, all other parameters projected out.
    effects : sequence of ndarray, shape (N, D)
        Columns of the deviations of each random effect, all other parameters projected out.
    """
    Z = np.hstack(effects)
    A, b = Z.T @ Z, Z.T @ z
    effect = np.repeat(np.arange(len(effects)), [columns.shape[1] for columns in effects])

    def cost(log_widths: ArrayLike) -> float:
        try:
            return -restricted_likelihood(A, b, np.exp(np.atleast_1d(log_widths))[effect])[0]
        except np.linalg.LinAlgError:  # of widths far too large, by rounding
            return np.inf

    if len(effects) == 1:
        nearest = min(LOG_WIDTHS.tolist(), key=cost)
        bounds = (nearest - 0.25, nearest + 0.25)
        log_widths = np.array([scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded").x])
    else:
        single = [estimate_widths(z, [columns]).widths[0] for columns in effects]
        start = np.log(np.maximum(single, np.exp(LOG_WIDTHS[0])))
        log_widths = scipy.optimize.minimize(cost, start, method="Nelder-Mead", tol=0.01).x
    log_likelihood, _, y = restricted_likelihood(A, b, np.exp(log_widths)[effect])
    if log_likelihood <= 0:
        return WidthEstimate((0.0,) * len(effects), 0.0, 0.0)
    return WidthEstimate(tuple(np.exp(log_widths).tolist()), log_likelihood, float(y @ y))


@dataclass(frozen=True)
class Heterogeneity:
    """By how much a common parameter differs between the experiments.

    Attributes
    ----------
    width : float
        Standard deviation between the experiments, in the unit of the parameter.
    variance : float
        What that adds to the variance of the mean that was fitted.
    p : float
        Probability of such a width without any difference.
    """

    width: float
    variance: float
    p: float


def heterogeneity(model: JointModel, params: lmfit.Parameters, index: int) -> Heterogeneity | None:
    """Return by how much a parameter differs between runs; None where fewer than two determine it."""
    residual, gradient = model.residual(params), model.gradient(params)
    run_sizes = [len(run.root) for run in model.runs]
    run_index = np.repeat(np.arange(len(run_sizes)), run_sizes)
    Z = np.zeros((len(residual), len(run_sizes)))
    Z[np.arange(run_index.size), run_index] = gradient[: run_index.size, index]
    Z = Z[:, Z.any(axis=0)]
    if Z.shape[1] < 2:
        return None
    free = free_directions(params)
    scale = np.linalg.norm(gradient @ free, axis=0)
    Q, R = np.linalg.qr(gradient @ free / scale)
    weights = (free / scale)[index] @ np.linalg.solve(R, Q.T @ Z)  # of each run in the mean
    z, Z = residual - Q @ (Q.T @ residual), Z - Q @ (Q.T @ Z)
    unit = 10 / float(np.linalg.norm(Z, axis=0).min())
    estimate = estimate_widths(z, [Z * unit])
    width = estimate.widths[0] * unit
    return Heterogeneity(width, width**2 * float(weights @ weights), estimate.p)


@dataclass(frozen=True)
class WeightedMean:
    """Mean of independent estimates of one quantity, weighted by their errors, and how they scatter about it.

    Attributes
    ----------
    mean, sigma : float
        The mean, and its standard deviation if only the errors differ.
    chi2, dof : float and int
        Cochran's Q, the chi^2 about the mean, and its degrees of freedom.
    width : float
        Standard deviation among the true values, by restricted maximum likelihood.
    sigma_with_scatter : float
        Standard deviation of the mean if the true values scatter by that.
    """

    mean: float
    sigma: float
    chi2: float
    dof: int
    width: float
    sigma_with_scatter: float

    @property
    def chi2_red(self) -> float:
        """chi^2 over its degrees of freedom."""
        return self.chi2 / self.dof

    @property
    def p(self) -> float:
        """Probability that errors alone exceed chi2."""
        return float(scipy.special.chdtrc(self.dof, self.chi2))


def weighted_mean(estimates: Sequence[Estimate]) -> WeightedMean:
    """Return the weighted mean of two or more independent estimates."""
    values, sigmas = (np.array([getattr(e, name) for e in estimates]) for name in ("value", "sigma"))
    unit = float(max(np.ptp(values), sigmas.max()))
    weights = unit / sigmas
    axis = weights / np.linalg.norm(weights)  # of the mean
    project = np.eye(values.size) - np.outer(axis, axis)
    mean = float(weights**2 @ values / (weights @ weights))
    z = (values - mean) / sigmas
    width = estimate_widths(z, [project * weights]).widths[0] * unit
    return WeightedMean(
        mean=mean,
        sigma=float(np.sum(sigmas**-2.0) ** -0.5),
        chi2=float(z @ z),
        dof=values.size - 1,
        width=width,
        sigma_with_scatter=float(np.sum(1 / (sigmas**2 + width**2)) ** -0.5),
    )
