"""Estimation: from runs to estimates, their sigmas, and a verdict on both.

Runs become spectra of the model's columns, least squares with the weights of the noise runs is repeated
until nothing moves, and a verdict tells whether the sigmas hold. Forecasts, samples of the posterior and
the pulls of many campaigns rest on the same fit.
"""

from fit.estimate.forecast import Planned
from fit.estimate.irls import Known, Outcome
from fit.estimate.joint import fit_experiment, known_of
from fit.estimate.leftout import LeftOut
from fit.estimate.masks import Prepared, prepare, searches
from fit.estimate.posterior import Posterior
from fit.estimate.pulls import Pulls
from fit.estimate.residuals import SCORES
from fit.estimate.runs import SHORTEST, Experiment, Run, divide, pair

__all__ = [
    "SCORES",
    "SHORTEST",
    "Experiment",
    "Known",
    "LeftOut",
    "Outcome",
    "Planned",
    "Posterior",
    "Prepared",
    "Pulls",
    "Run",
    "admission",
    "bump",
    "divide",
    "earlier",
    "fit_experiment",
    "forecast",
    "inertial",
    "jury",
    "known_of",
    "leftout",
    "levels",
    "pair",
    "prepare",
    "pulls",
    "residuals",
    "sampling",
    "searches",
    "steadiness",
    "verdict",
]
