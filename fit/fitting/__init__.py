"""Fitting: runs compressed to their own estimates, and one lmfit problem for all that share parameters.

A `RunEstimate` holds all that a whitened run says: its coefficients and their true covariance. A `JointModel`
of such runs is what every fit minimises, and what a user gets for whatever else lmfit does with a model.
"""

from fit.fitting import constraints
from fit.fitting.joint_model import (
    JointModel,
    LinearEquation,
    Prior,
    SolvedModel,
    delta_chi2,
    lmfit_names,
    lmfit_params,
    parameter_values,
)
from fit.fitting.run_estimate import RunEstimate, run_estimate, score_whitening

__all__ = [
    "JointModel",
    "LinearEquation",
    "Prior",
    "RunEstimate",
    "SolvedModel",
    "constraints",
    "delta_chi2",
    "lmfit_names",
    "lmfit_params",
    "parameter_values",
    "run_estimate",
    "score_whitening",
]
