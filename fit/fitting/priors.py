"""What is known of parameters beside the data: weak priors of what is undetermined, and other fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.fitting.joint_model import Prior
from fit.model import dynamics
from fit.parameters import Parameter
from fit.whitening import whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Known:
    """What another fit knows of the parameters of a run.

    Attributes
    ----------
    theta : ndarray, shape (K,)
        Values.
    covariance : ndarray, shape (K, K)
        Theirs.
    """

    theta: Array
    covariance: Array


@dataclass(frozen=True)
class PriorSet:
    """What is known beside the data.

    Attributes
    ----------
    priors : mapping of int to Prior
        Of single parameters, by their place.
    lost : ndarray of bool, shape (P,)
        True for indeterminable parameters.
    directions : ndarray, shape (K, P)
        See `linear.blind`.
    tone : float or None
        See `IRLSResult`.
    correlated : whitened_run.Prior or None
        Of several parameters at once.
    """

    priors: Mapping[int, Prior]
    lost: NDArray[np.bool_]
    directions: Array
    tone: float | None
    correlated: whitened_run.Prior | None = None

    def rows(self, known: Mapping[int, Prior]) -> whitened_run.Prior:
        """Return all of it as rows of chi^2, with other priors `known` of single parameters."""
        if self.correlated is not None:
            return self.correlated
        centre, priors = np.zeros(self.lost.size), {**self.priors, **known}
        for i, prior in priors.items():
            centre[i] = prior.mean
        return whitened_run.Prior(centre, prior_rows(priors, self.lost.size))


def weak_priors(
    blocks: Sequence[whitened_run.WhitenedRun],
    theta: Array,
    parameters: Sequence[Parameter],
    share: Array,
    more: Array,
    constrained: NDArray[np.bool_] | None = None,
) -> PriorSet:
    """Return the weak priors of whatever the data do not determine.

    Parameters
    ----------
    blocks : sequence of whitened_run.WhitenedRun
        The data.
    theta : ndarray, shape (P,)
        The estimate.
    parameters : sequence of Parameter
        The P parameters.
    share : ndarray, shape (K, P)
        Of a run, see `linear.WhitenedRun`.
    more : ndarray, shape (N, P)
        What is known beside the data, as rows of chi^2.
    constrained : ndarray of bool, shape (P,), optional
        Of which parameters that is known from the user.
    """
    width, tone = np.array([p.prior_sigma for p in parameters]), common_tone(blocks)
    lost, directions = whitened_run.blind(whitened_run.information(blocks, theta) + more.T @ more, width)
    if tone is not None:
        out = beyond(tone, share)
        if constrained is None or not (out & constrained).any():
            lost |= out
    priors = {i: Prior(p.value, p.prior_sigma) for i, p in enumerate(parameters) if lost[i]}
    return PriorSet(priors, lost, directions, tone)


def prior_rows(priors: Mapping[int, Prior], size: int) -> Array:
    """Return priors as rows of a `linear.Prior`."""
    sigmas = [[prior.sigma] for prior in priors.values()]
    return np.asarray(np.eye(size)[list(priors)] / np.reshape(sigmas, (-1, 1)))


def common_tone(blocks: Sequence[whitened_run.WhitenedRun]) -> float | None:
    """Return the one frequency of all signals, 0 if there are none, else None."""
    if any(block.tone is None for block in blocks):
        return None
    tones = [block.tone for block in blocks if block.tone]
    if not tones:
        return 0.0
    return tones[0] if max(tones) < np.sqrt(2) * min(tones) else None


def beyond(tone: float, share: Array) -> NDArray[np.bool_]:
    """Tell which parameters a single tone, or no signal at all, leaves undetermined."""
    names = ("lambda_2", "omega2_2") if tone else ("lambda_2", "C_2", "omega2_2")
    rows = [dynamics.PARAMETERS.index(name) for name in names]
    return np.asarray(np.any(share[rows] != 0, axis=0))


def all_but_lambda_2(known: Known, share: Array) -> tuple[whitened_run.Prior, NDArray[np.bool_]]:
    """Return what is known of a run, its gain excepted, as prior in the order of its own parameters."""
    others = np.arange(len(share)) != dynamics.PARAMETERS.index("lambda_2")
    root = np.linalg.cholesky(known.covariance[np.ix_(others, others)])
    return whitened_run.Prior(share.T @ known.theta, np.linalg.inv(root) @ share[others]), share[others].any(
        axis=0
    )
