"""A posterior that is known exactly."""

import numpy as np
import pytest

from fit.fitting.irls import IRLSResult
from fit.fitting.joint_model import JointModel, Prior
from fit.fitting.parameter_set import ParameterSet
from fit.fitting.run_estimate import run_estimate
from fit.parameters import FLIGHT
from fit.whitening import whitened_run
from fit.whitening.likelihoods import weights

TAU = (0.1, 0.2)


@pytest.fixture
def linear_case():
    """A posterior that is Gaussian exactly: outcome, and mean and covariance written out by hand."""
    rng = np.random.default_rng(5)
    B, size = 300, np.array([1.0, 4.0, 30.0, 1.0, 30.0, 2e7, 1e6, 1.0])
    U = size * (rng.standard_normal((B, 8)) + 1j * rng.standard_normal((B, 8)))
    truth = np.array([1.08, 0.19, -4e-7])
    U[:, 2] += 2 * U[:, 1]  # correlates the parameters
    # residual = o_12'' - lambda_2 f + (C_2 - lambda_2 tau) f' + omega2_2 (o_12 + o_1)
    design = np.stack([-U[:, 1] - TAU[1] * U[:, 2], U[:, 2], U[:, 5] + U[:, 6]], axis=1)
    U[:, 0] = rng.standard_normal(B) + 1j * rng.standard_normal(B) - design @ truth
    centre, rows = np.array([1.0776, 0.186, -4.19e-7]), np.array([[0.0, 0.0, 2.5e8]])
    A = np.concatenate([design.real, design.imag, rows])
    b = np.concatenate([-U[:, 0].real, -U[:, 0].imag, rows @ centre])
    covariance = np.linalg.inv(A.T @ A)
    mean = covariance @ A.T @ b
    share = np.zeros((7, 3))
    share[[1, 3, 4, 5], [0, 1, 2, 2]] = 1
    block = whitened_run.WhitenedRun(
        TAU, U, weights("gaussian", np.arange(B) + 1.0, np.full(B, 2.0)), None, share
    )
    sigma = np.sqrt(np.diag(covariance))
    # where it starts from is beside the truth and too wide: the chain must not depend on it
    solution = whitened_run.Solution(mean + 0.5 * sigma, 1.5 * covariance, 1.0, 1)
    parameters = tuple(FLIGHT[name] for name in ("lambda_2", "C_2", "omega2_2_0"))
    parameter_set, model = ParameterSet(parameters), JointModel([run_estimate("A", block)])
    return (
        IRLSResult(
            parameters=parameters,
            solution=solution,
            undetermined=np.zeros(3, dtype=bool),
            directions=np.empty((0, 3)),
            converged=True,
            whitened_runs=(block,),
            prior=whitened_run.Prior(centre, rows),
            model=model,
            result=model.fit(parameter_set.params(centre, {2: Prior(centre[2], 4e-9)})),
            parameter_set=parameter_set,
            scatter={},
        ),
        mean,
        covariance,
    )
