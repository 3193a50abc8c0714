"""A finished fit as a normal distribution: information and score of its runs about the estimate.

The window makes neighbouring bins one noise, so that chi^2 as it stands claims more information than there is
(see `posterior`); the chi^2 of every run is therefore divided by its mean ratio of the two.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit.fitting.hierarchy import Normal
from fit.whitening import whitened_run

Array = NDArray[np.float64]

_NULL = 1e-10  # information relative to the largest, below which a run does not see a direction


def of_runs(
    blocks: Sequence[whitened_run.WhitenedRun], theta: Array, inflations: Sequence[float]
) -> list[Normal]:
    """Return what each run alone says of its own K parameters at the joint theta, shape (P,)."""
    found = []
    for block, k in zip(blocks, inflations, strict=True):
        of_run, to_columns = block.share @ theta, block.of_run(theta)
        left = block.R.T @ (block.R @ block.coefficients(theta))
        found.append(Normal(to_columns.T @ block.H @ to_columns / k, -to_columns.T @ left / k, of_run))
    return found


def inverse(H: Array) -> Array:
    """Return the inverse of normal equations, shape (P, P), whatever the units of their parameters."""
    scale = 1 / np.sqrt(np.abs(np.diag(H)))
    return np.asarray(np.linalg.inv(H * np.outer(scale, scale)) * np.outer(scale, scale))


def joined(
    blocks: Sequence[whitened_run.WhitenedRun],
    prior: whitened_run.Prior,
    theta: Array,
    inflations: Sequence[float],
) -> Normal:
    """Return what all runs and a prior say of the joint parameters theta, shape (P,)."""
    H = prior.rows.T @ prior.rows
    b = -prior.rows.T @ (prior.rows @ (theta - prior.centre))
    for block, own in zip(blocks, of_runs(blocks, theta, inflations), strict=True):
        H = H + block.share.T @ own.H @ block.share
        b = b + block.share.T @ own.b
    return Normal(H, b, theta)


def about_zero(normal: Normal, members: Sequence[int]) -> Normal:
    """Return the same about a point at which these parameters are zero."""
    moved = np.zeros_like(normal.at)
    moved[list(members)] = normal.at[list(members)]
    return Normal(normal.H, normal.b + normal.H @ moved, normal.at - moved)


def inflations(blocks: Sequence[whitened_run.WhitenedRun], theta: Array) -> tuple[float, ...]:
    """Return by what the likelihood of each run is divided.

    That of a run whose bins are weighed by their own residual hangs on the few bins of its tones: such runs
    share their mean, lest it weigh them against each other.
    """
    found = [inflation(block, theta) for block in blocks]
    own = [k for k, block in zip(found, blocks, strict=True) if block.weights.likelihood != "gaussian"]
    mean = float(np.mean(own)) if own else 1.0
    return tuple(
        k if block.weights.likelihood == "gaussian" else mean for k, block in zip(found, blocks, strict=True)
    )


def inflation(block: whitened_run.WhitenedRun, theta: Array) -> float:
    """Return the mean, over the directions that a run determines, of true variance by claimed variance.

    Parameters
    ----------
    block : whitened_run.WhitenedRun
        The run.
    theta : ndarray, shape (P,)
        The estimate.
    """
    c = block.of_run(theta)
    H, M = c.T @ block.H @ c, c.T @ block.M @ c
    diagonal = np.diag(H)
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * H * scale)
    seen = values > _NULL * values[-1]
    V = scale[:, None] * vectors[:, seen] / np.sqrt(values[seen])  # V^T H V = 1
    return float(np.trace(V.T @ M @ V) / seen.sum())
