"""Prior knowledge of parameters: weak priors of what is undetermined, and other fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.fitting.joint_model import Prior
from fit.fitting.null_space import null_space
from fit.parameters import Parameter
from fit.whitening import whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PriorSet:
    """Prior knowledge.

    Attributes
    ----------
    priors : mapping of int to Prior
        Of single parameters, by their place.
    undetermined : ndarray of bool, shape (P,)
        True for indeterminable parameters.
    directions : ndarray, shape (K, P)
        See `null_space`.
    """

    priors: Mapping[int, Prior]
    undetermined: NDArray[np.bool_]
    directions: Array

    def rows(self, known: Mapping[int, Prior]) -> whitened_run.Prior:
        """Return all of it as rows of chi^2, with other priors `known` of single parameters."""
        centre, priors = np.zeros(self.undetermined.size), {**self.priors, **known}
        for i, prior in priors.items():
            centre[i] = prior.mean
        return whitened_run.Prior(centre, prior_rows(priors, self.undetermined.size))


def weak_priors(
    parameters: Sequence[Parameter],
    whitened_runs: Sequence[whitened_run.WhitenedRun],
    theta: Array,
    known_rows: Array,
) -> PriorSet:
    """Return the weak priors of whatever the data do not determine.

    Parameters
    ----------
    parameters : sequence of Parameter
        The P parameters.
    whitened_runs : sequence of whitened_run.WhitenedRun
        The data.
    theta : ndarray, shape (P,)
        The estimate.
    known_rows : ndarray, shape (N, P)
        Prior knowledge, as rows of chi^2.
    """
    width = np.array([p.prior_sigma for p in parameters])
    undetermined, directions = null_space(
        whitened_run.information(whitened_runs, theta) + known_rows.T @ known_rows, width
    )
    priors = {i: Prior(p.value, p.prior_sigma) for i, p in enumerate(parameters) if undetermined[i]}
    return PriorSet(priors, undetermined, directions)


def prior_rows(priors: Mapping[int, Prior], size: int) -> Array:
    """Return priors as rows of a `whitened_run.Prior`."""
    sigmas = [[prior.sigma] for prior in priors.values()]
    return np.asarray(np.eye(size)[list(priors)] / np.reshape(sigmas, (-1, 1)))
