"""Heterogeneity of estimates of one quantity: scatter beyond their errors (Paule and Mandel)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from fit.results import Estimate, Fit


@dataclass(frozen=True)
class Heterogeneity:
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


def independent_estimates(experiments: Mapping[str, Fit], name: str = "lambda_2") -> dict[str, Estimate]:
    """Return the estimates of a parameter by the experiments that determine it."""
    return {
        experiment: fit.parameters[name] for experiment, fit in experiments.items() if name in fit.parameters
    }


def paule_mandel(estimates: Sequence[Estimate]) -> Heterogeneity:
    """Return the heterogeneity of two or more independent estimates of one quantity."""
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
    return Heterogeneity(
        mean=value,
        sigma=float(np.sqrt(squared)),
        chi2_red=chi2(0.0) / dof,
        p_value=float(scipy.special.chdtrc(dof, chi2(0.0))),
        scatter=float(np.sqrt(extra)),
        sigma_with_scatter=float(np.sqrt(mean(extra)[1])),
        dof=dof,
    )
