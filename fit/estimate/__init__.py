"""Estimation: from runs to estimates, their sigmas, and a verdict on both.

Runs become spectra of the model's columns, least squares with the weights of the noise runs is repeated
until nothing moves, and a verdict tells whether the sigmas hold. Forecasts, samples of the posterior and
the pulls of many campaigns rest on the same fit.
"""

from fit.estimate.bump import is_separated, sums
from fit.estimate.earlier import SAME
from fit.estimate.forecast import Planned, document, expected_fit
from fit.estimate.irls import Known, Outcome
from fit.estimate.joint import fit_experiment, fit_joint, known_of
from fit.estimate.masks import Prepared, prepare
from fit.estimate.posterior import Posterior
from fit.estimate.pulls import Pulls
from fit.estimate.residuals import SCORES, Stationarity, about_mean, diagnose, independent
from fit.estimate.runs import SHORTEST, Experiment, Run, divide, pair
from fit.estimate.verdict import as_fit

__all__ = [
    "SAME",
    "SCORES",
    "SHORTEST",
    "Experiment",
    "Known",
    "Outcome",
    "Planned",
    "Posterior",
    "Prepared",
    "Pulls",
    "Run",
    "Stationarity",
    "about_mean",
    "as_fit",
    "bump",
    "diagnose",
    "divide",
    "document",
    "earlier",
    "expected_fit",
    "fit_experiment",
    "fit_joint",
    "forecast",
    "independent",
    "inertial",
    "is_separated",
    "known_of",
    "pair",
    "prepare",
    "pulls",
    "sampling",
    "sums",
    "verdict",
]
