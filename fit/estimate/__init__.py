"""Estimation: from runs to estimates with true sigmas, verdicts, forecasts, samples of the posterior."""

from fit.estimate.chains import head
from fit.estimate.diagnostics import SCORES, diagnose
from fit.estimate.forecast import Planned, document, expected_fit
from fit.estimate.irls import Known, Outcome
from fit.estimate.joint import fit_experiment, fit_joint, known_of
from fit.estimate.posterior import Posterior
from fit.estimate.preparation import prepare
from fit.estimate.pulls import Pulls
from fit.estimate.refit import SAME
from fit.estimate.runs import Experiment, Run
from fit.estimate.separation import is_separated
from fit.estimate.stationarity import Stationarity, about_mean, independent
from fit.estimate.verdict import as_fit

__all__ = [
    "SAME",
    "SCORES",
    "Experiment",
    "Known",
    "Outcome",
    "Planned",
    "Posterior",
    "Pulls",
    "Run",
    "Stationarity",
    "about_mean",
    "as_fit",
    "bump",
    "diagnose",
    "document",
    "expected_fit",
    "fit_experiment",
    "fit_joint",
    "forecast",
    "head",
    "independent",
    "inertial",
    "is_separated",
    "known_of",
    "mcmc",
    "prepare",
    "pulls",
    "refit",
    "selection",
    "separation",
    "soundness",
]
