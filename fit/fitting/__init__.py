"""Fitting: runs compressed to their own estimates, and one lmfit problem for all that share parameters.

A `RunEstimate` holds all that a whitened run says: its coefficients and their true covariance. A `JointModel`
of such runs is what every fit minimises, and what a user gets for whatever else lmfit does with a model. One
iteration, `irls.iterate`, moves weights, delays and parameters until nothing moves.
"""

from fit.fitting import constraints
from fit.fitting.hierarchy import Normal, Width
from fit.fitting.irls import HARMLESS, MAX_ITERATIONS, TOLERANCE, Outcome, Rule, iterate, reweight
from fit.fitting.joint_model import Prior, delta_chi2, lmfit_params, parameter_values
from fit.fitting.priors import Known, PriorSet, weak_priors
from fit.fitting.problem import FREE
from fit.fitting.run_estimate import score_whitening

__all__ = [
    "FREE",
    "HARMLESS",
    "MAX_ITERATIONS",
    "TOLERANCE",
    "Known",
    "Normal",
    "Outcome",
    "Prior",
    "PriorSet",
    "Rule",
    "Width",
    "constraints",
    "delta_chi2",
    "flscov",
    "hierarchy",
    "irls",
    "iterate",
    "lmfit_params",
    "louder",
    "parameter_values",
    "priors",
    "reweight",
    "score_whitening",
    "unsteady",
    "weak_priors",
]
