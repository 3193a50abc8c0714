"""Sums of parameters that the data know though their parts are lost, such as a stiffness."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fit.fitting import IRLSResult
from fit.parameters import stiffness_terms
from fit.results import Stiffness
from fit.telemetry import Telemetry

KNOWN = 0.1  # of the width of its weak prior that the sigma of a sum may have: the prior is 1 % of it


def linear_combination(outcome: IRLSResult, factors: Mapping[str, float]) -> tuple[float, float] | None:
    """Return a sum of parameters of a fit, ``factors`` times each, and its sigma; None if the data leave it.

    Weak priors hold what is lost, so that the covariance is that of all parameters.
    """
    names = [p.name for p in outcome.parameters]
    if not factors.keys() <= set(names):
        return None
    row = np.array([factors.get(name, 0.0) for name in names])
    prior = math.sqrt(sum((f * p.prior_sigma) ** 2 for f, p in zip(row, outcome.parameters, strict=True)))
    solution = outcome.solution
    sigma = math.sqrt(max(float(row @ solution.covariance @ row), 0.0))
    return (float(row @ solution.theta), sigma) if 0 < sigma < KNOWN * prior else None


def stiffnesses(outcome: IRLSResult, runs: Sequence[Telemetry]) -> tuple[Stiffness, ...]:
    """Return what a joint fit says of omega2_j at the authorities of its runs (eq. stiff_model)."""
    settings = dict.fromkeys((j, *run.authority[j - 1]) for j in (1, 2) for run in runs)
    combinations = [(setting, linear_combination(outcome, stiffness_terms(*setting))) for setting in settings]
    return tuple(Stiffness(*setting, *combination) for setting, combination in combinations if combination)
