"""What the residual of an experiment is like beside its noise model: level, whiteness, tails.

Level: chi2 over its degrees of freedom, with the scatter to expect of it. Whiteness: Bartlett's test on the
cumulative periodogram of the whitened residual (a Kolmogorov-Smirnov test), the largest departure of the
accumulated share of power from the share of bins, in units of its standard deviation there. Three things
shape that deviation and are in it: the window, which makes neighbouring bins one noise; the noise model,
whose own error shifts whole stretches of bins; and, without a noise run, that the model has followed this
very residual. Tails: quantiles and kurtosis of the normalised residual. A Gaussian likelihood takes all
three for granted.

Of 2000 synthetic runs of six hours beside noise runs of eight, 5.5 % fell below a p-value of 5 % and 0.9 %
below one of 1 %; of 1000 without noise runs 7.0 % and 1.7 %.

Beside each residual by itself stands whether a gain is the same in every experiment (`about_mean`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import IRLSResult
from fit.model import dynamics
from fit.results import QUANTILES, Diagnostics, Estimate, Fit
from fit.spectra import NoiseModel
from fit.whitening import Experiment, noise_model, whitened_run

Array = NDArray[np.float64]

SCORES = np.linspace(-3.25, 3.25, QUANTILES)  # normal scores at which the quantiles are told
DRAWS = 4000  # of the departure under noise, for its p-value: +- 0.003 at 5 %
FIRST = 128  # bins to accumulate before a departure counts; fewer are no normal variable yet
POINTS = 120  # at most, along the cumulative periodogram


@dataclass(frozen=True)
class Residual:
    """The whitened residual of one experiment.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz].
    z : ndarray of complex, shape (B,)
        Real and imaginary part have variance 1 each where the model holds.
    noise : NoiseModel
        By which it was whitened.
    correlation : float
        Sum of the squared correlations of a bin with all bins: 1 without a window, 1.06 with the default.
    independent : bool
        Whether the noise model is that of another run.
    taken : int
        How many real numbers were projected out of it.
    """

    f: Array
    z: NDArray[np.complex128]
    noise: NoiseModel
    correlation: float
    independent: bool
    taken: int = 2


def diagnose(experiment: Experiment, outcome: IRLSResult) -> Diagnostics:
    """Judge the residual that a fit of one experiment on its own leaves.

    Raises
    ------
    FitError
        If the noise has no PSD.
    """
    share, solution = outcome.blocks[0].share, outcome.solution
    left = residual(experiment, share @ solution.theta, share @ solution.covariance @ share.T)
    return judge(left, taken=int(np.count_nonzero(~outcome.lost)) + left.taken)


def residual(experiment: Experiment, theta: Array, covariance: Array) -> Residual:
    """Whiten the residual of an experiment, however it was fitted, by the smooth PSD of its noise.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    theta, covariance : ndarray, shapes (K,) and (K, K)
        Estimate of the parameters of the experiment, in their order there.

    Raises
    ------
    FitError
        If the noise has no PSD.
    """
    noise = noise_model(experiment, theta, covariance, None)
    run = experiment.sysid
    terms = run.spectra(dynamics.delays(theta))
    # the error of a model that has followed this very residual makes it neither louder nor quieter
    S = noise.expected(terms.f) if experiment.noise else noise(terms.f)
    z = whitened_run.whiten(terms.summed(dynamics.coefficients(theta, terms.tau)), S)[0][:, 0]
    w2 = terms.window**2
    correlation = w2.size * float(w2 @ w2) / float(w2.sum()) ** 2
    return Residual(terms.f, z, noise, correlation, experiment.noise is not None, terms.nuisance.shape[1])


def judge(left: Residual, taken: int) -> Diagnostics:
    """Judge a residual.

    Parameters
    ----------
    left : Residual
        Of one experiment.
    taken : int
        How many real numbers the fit has taken out of it, constant and ramp included.
    """
    values = np.concatenate([left.z.real, left.z.imag])
    power = np.abs(left.z) ** 2 / 2
    ends = np.unique(np.geomspace(min(FIRST, power.size // 2), power.size, POINTS).astype(int))
    covariance = _accumulated(left, ends)
    return Diagnostics(
        chi2_red=float(values @ values) / (values.size - taken),
        chi2_red_sigma=math.sqrt(max(float(covariance[-1, -1]), 0.0)) / power.size,
        whiteness=_whiteness(power, ends, covariance),
        kurtosis=_kurtosis(values),
        kurtosis_sigma=float(np.sqrt(24 / values.size)),
        quantiles=np.quantile(values, scipy.special.ndtr(SCORES)).tolist(),
    )


def _kurtosis(x: Array) -> float:
    squares = (x - x.mean()) ** 2
    return float(np.mean(squares**2) / np.mean(squares) ** 2 - 3)


def _whiteness(power: Array, ends: NDArray[np.intp], covariance: Array) -> float:
    """Return how often noise departs farther from a straight cumulative periodogram than this residual."""
    B = power.size
    # the share of power, so that a wrong level is left to chi2: the walk becomes a bridge
    bridge = np.eye(ends.size) - np.outer(ends / B, np.arange(ends.size) == ends.size - 1)
    covariance = (bridge @ covariance @ bridge.T)[:-1, :-1]
    departure = (np.cumsum(power)[ends - 1] / power.mean() - ends)[:-1]
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0))
    sigma = np.sqrt(np.diag(covariance))
    drawn = _drawn(sigma.size) @ (root.T / sigma)
    farther = np.max(np.abs(drawn), axis=1) >= np.max(np.abs(departure) / sigma)
    return float((1 + np.count_nonzero(farther)) / (1 + DRAWS))


@lru_cache(maxsize=4)  # of 4 MB; few campaigns have runs of more lengths that matter
def _drawn(size: int) -> Array:
    drawn = np.random.default_rng(0).standard_normal((DRAWS, size))
    drawn.setflags(write=False)  # others get the same ones
    return drawn


def _accumulated(left: Residual, ends: NDArray[np.intp]) -> Array:
    """Return the covariance of the normalised power summed over the first bins, up to each of `ends`."""
    followed = _followed(left.noise.knots.tobytes(), left.f.tobytes(), tuple(ends), left.independent)
    walk = np.minimum.outer(ends, ends)
    if left.independent:
        walk = walk + followed @ left.noise.covariance @ followed.T
    else:  # the model has taken out what it could follow
        walk = walk - followed @ followed.T
    return np.asarray(left.correlation * walk, dtype=np.float64)


@lru_cache(maxsize=16)  # the runs of a campaign have few lengths
def _followed(of_knots: bytes, of_f: bytes, ends: tuple[int, ...], independent: bool) -> Array:
    """Return the derivatives of log S by the knots, orthonormal unless independent, summed up to `ends`."""
    knots, u = np.frombuffer(of_knots), np.log(np.frombuffer(of_f))
    spline = scipy.interpolate.CubicSpline(knots, np.eye(knots.size), bc_type="natural")
    found, squares = np.empty((len(ends), knots.size)), np.zeros((knots.size, knots.size))
    total = np.zeros(knots.size)
    for k, (begin, end) in enumerate(pairwise((0, *ends))):  # of weeks, all bins fill the memory
        basis = spline(np.clip(u[begin:end], knots[0], knots[-1]))
        squares += basis.T @ basis
        total += basis.sum(axis=0)
        found[k] = total
    if not independent:
        found = scipy.linalg.solve_triangular(np.linalg.cholesky(squares), found.T, lower=True).T
    found.setflags(write=False)
    return np.asarray(found)


@dataclass(frozen=True)
class Stationarity:
    """Scatter of estimates about their weighted mean.

    Attributes
    ----------
    mean, sigma : float
        Weighted mean, and its standard deviation if only the errors of the estimates scatter.
    chi2_red, p_value : float
        chi^2 over its degrees of freedom, and how often errors alone would exceed it.
    scatter : float
        Standard deviation beyond the errors that brings chi2_red down to 1, 0 where it is below.
    sigma_with_scatter : float
        Standard deviation of the mean of such a gain.
    dof : int
        Number of estimates less 1.
    """

    mean: float
    sigma: float
    chi2_red: float
    p_value: float
    scatter: float
    sigma_with_scatter: float
    dof: int


def independent(experiments: Mapping[str, Fit], name: str = "lambda_2") -> dict[str, Estimate]:
    """Return the estimates of a parameter by the experiments that determine it."""
    return {
        experiment: fit.parameters[name] for experiment, fit in experiments.items() if name in fit.parameters
    }


def about_mean(estimates: Sequence[Estimate]) -> Stationarity:
    """Judge two or more independent estimates of one quantity."""
    x = np.array([e.value for e in estimates])
    variance = np.array([e.sigma**2 for e in estimates])
    dof = x.size - 1

    def mean(extra: float) -> tuple[float, float]:
        """Return the weighted mean and its variance."""
        weight = 1 / (variance + extra)
        return float(weight @ x / weight.sum()), float(1 / weight.sum())

    def chi2(extra: float) -> float:
        return float(np.sum((x - mean(extra)[0]) ** 2 / (variance + extra)))

    # chi2 falls with the extra variance, and is below dof for certain where that exceeds the spread
    extra = 0.0
    if chi2(0.0) > dof:
        extra = float(scipy.optimize.brentq(lambda v: chi2(v) - dof, 0.0, np.ptp(x) ** 2))
    value, squared = mean(0.0)
    return Stationarity(
        mean=value,
        sigma=float(np.sqrt(squared)),
        chi2_red=chi2(0.0) / dof,
        p_value=float(scipy.special.chdtrc(dof, chi2(0.0))),
        scatter=float(np.sqrt(extra)),
        sigma_with_scatter=float(np.sqrt(mean(extra)[1])),
        dof=dof,
    )
