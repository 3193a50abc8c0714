"""Estimation: from runs to estimates, their sigmas, and a verdict on both.

Least squares with the weights of the noise runs is repeated until nothing moves, and a verdict tells whether
the sigmas hold. Forecasts, samples of the posterior and the pulls of many campaigns rest on the same fit.
"""

from fit.estimate.angles import PlannedTurn
from fit.estimate.forecast import Planned
from fit.estimate.joint import constraints_of, fit_experiment, fit_joint, known_of
from fit.estimate.posterior import Posterior
from fit.estimate.pulls import Pulls
from fit.estimate.residuals import SCORES

__all__ = [
    "SCORES",
    "Planned",
    "PlannedTurn",
    "Posterior",
    "Pulls",
    "angles",
    "attenuation",
    "bump",
    "centrifugal",
    "constraint_test",
    "constraints_of",
    "departures",
    "earlier",
    "fit_experiment",
    "fit_joint",
    "forecast",
    "inertial",
    "known_of",
    "levels",
    "pulls",
    "residuals",
    "sampling",
    "sight",
    "steadiness",
    "user_params",
    "verdict",
]
