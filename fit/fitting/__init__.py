"""Fitting: runs compressed to their own estimates, and one lmfit problem for all that share parameters.

A `RunEstimate` holds all that a whitened run says: its coefficients and their true covariance. A `JointModel`
of such runs is what every fit minimises, and what a user gets for whatever else lmfit does with a model. One
iteration, `irls.iterate`, moves weights, delays and parameters until nothing moves.
"""

from fit.fitting.experiment_and_joint_fit import (
    fit_experiment,
    fit_joint,
    joint_parameters,
    linear_combination,
    names_of,
    report,
    stiffnesses,
)
from fit.fitting.irls import Convergence, IRLSResult, iterate
from fit.fitting.joint_model import (
    JointModel,
    Prior,
    free_directions,
    parameter_values,
    prior_rows,
    varying,
)
from fit.fitting.null_space import NullSpace
from fit.fitting.random_effects import (
    FREE,
    Heterogeneity,
    ScaleParameter,
    estimate_widths,
    heterogeneity,
    weighted_mean,
)
from fit.fitting.regressor_noise import CorrectedRun
from fit.fitting.run_estimate import (
    RunEstimate,
    column_scale,
    moments,
    run_estimate,
    score_whitening,
)
from fit.fitting.solved_model import SolvedModel, delta_chi2
