"""A finished fit as a normal distribution: information and score of its runs about the estimate.

The window makes neighbouring bins one noise, so that chi^2 as it stands claims more information than there is
(see `posterior`); the chi^2 of every run is therefore divided by its mean ratio of the two.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit.fitting.hierarchy import NormalEquations
from fit.whitening import whitened_run

Array = NDArray[np.float64]

_NULL = 1e-10  # information relative to the largest, below which a run does not see a direction


def normal_equations_by_run(
    whitened_runs: Sequence[whitened_run.WhitenedRun], theta: Array, variance_factors: Sequence[float]
) -> list[NormalEquations]:
    """Return what each run alone says of its own K parameters at the joint theta, shape (P,)."""
    equations = []
    for block, k in zip(whitened_runs, variance_factors, strict=True):
        of_run, to_columns = block.parameter_map @ theta, block.run_gradient(theta)
        score = block.R.T @ (block.R @ block.coefficients(theta))
        equations.append(
            NormalEquations(to_columns.T @ block.H @ to_columns / k, -to_columns.T @ score / k, of_run)
        )
    return equations


def inverse(H: Array) -> Array:
    """Return the inverse of normal equations, shape (P, P), whatever the units of their parameters."""
    scale = 1 / np.sqrt(np.abs(np.diag(H)))
    return np.asarray(np.linalg.inv(H * np.outer(scale, scale)) * np.outer(scale, scale))


def joint_normal_equations(
    whitened_runs: Sequence[whitened_run.WhitenedRun],
    prior: whitened_run.Prior,
    theta: Array,
    variance_factors: Sequence[float],
) -> NormalEquations:
    """Return what all runs and a prior say of the joint parameters theta, shape (P,)."""
    H = prior.rows.T @ prior.rows
    b = -prior.rows.T @ (prior.rows @ (theta - prior.centre))
    for block, run_equations in zip(
        whitened_runs, normal_equations_by_run(whitened_runs, theta, variance_factors), strict=True
    ):
        H = H + block.parameter_map.T @ run_equations.H @ block.parameter_map
        b = b + block.parameter_map.T @ run_equations.b
    return NormalEquations(H, b, theta)


def recentre(normal: NormalEquations, members: Sequence[int]) -> NormalEquations:
    """Return the same about a point at which these parameters are zero."""
    deviations = np.zeros_like(normal.origin)
    deviations[list(members)] = normal.origin[list(members)]
    return NormalEquations(normal.H, normal.b + normal.H @ deviations, normal.origin - deviations)


def variance_factors(whitened_runs: Sequence[whitened_run.WhitenedRun], theta: Array) -> tuple[float, ...]:
    """Return by what the likelihood of each run is divided.

    That of a run whose bins are weighed by their own residual hangs on the few bins of its tones: such runs
    share their mean, lest it weigh them against each other.
    """
    factors = [variance_factor(block, theta) for block in whitened_runs]
    reweighted = [
        k for k, block in zip(factors, whitened_runs, strict=True) if block.weights.likelihood != "gaussian"
    ]
    mean = float(np.mean(reweighted)) if reweighted else 1.0
    return tuple(
        k if block.weights.likelihood == "gaussian" else mean
        for k, block in zip(factors, whitened_runs, strict=True)
    )


def variance_factor(block: whitened_run.WhitenedRun, theta: Array) -> float:
    """Return the mean, over the directions that a run determines, of true variance by claimed variance.

    Parameters
    ----------
    block : whitened_run.WhitenedRun
        The run.
    theta : ndarray, shape (P,)
        The estimate.
    """
    c = block.run_gradient(theta)
    H, M = c.T @ block.H @ c, c.T @ block.M @ c
    diagonal = np.diag(H)
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * H * scale)
    determined = values > _NULL * values[-1]
    V = scale[:, None] * vectors[:, determined] / np.sqrt(values[determined])  # V^T H V = 1
    return float(np.trace(V.T @ M @ V) / determined.sum())
