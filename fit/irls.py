"""Iteratively reweighted least squares (eq. irls) on one experiment or on many.

The paper divides by the previous residual, bin by bin; that leaves the estimates wider than their sigmas. The
weights here are a smooth PSD, fitted by likelihood to the residual of the adjacent noise run at the previous
estimate. The delays about which the commands are expanded move along, until nothing moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit import dynamics, linear
from fit.errors import FitError
from fit.parameters import Parameter
from fit.runs import Experiment, noise_model
from fit.spectra import NoiseModel

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
TOLERANCE = 1e-3  # sigma, least move that counts
HARMLESS = 0.05  # sigma, move that is put up with after MAX_ITERATIONS, and told
SETTLED = 6  # iterations after which the set of indeterminable parameters stays


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
class Outcome:
    """What the iteration ends with.

    Attributes
    ----------
    parameters : tuple of Parameter
        The P parameters.
    solution : linear.Solution
        The estimate.
    lost : ndarray of bool, shape (P,)
        True for indeterminable parameters.
    directions : ndarray, shape (K, P)
        See `linear.blind`.
    tone : float or None
        Frequency [Hz] of the only signal, if all runs hold the same single tone; 0 if none holds a signal.
    converged : bool
        Whether the last move was within TOLERANCE.
    """

    parameters: tuple[Parameter, ...]
    solution: linear.Solution
    lost: NDArray[np.bool_]
    directions: Array
    tone: float | None
    converged: bool


def reweight(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    known: Known | None = None,
) -> Outcome:
    """Iterate weights, delays and parameters until no determinable parameter moves by TOLERANCE sigma.

    Parameters
    ----------
    experiments : sequence of Experiment
        To be fitted together.
    shares : sequence of ndarray, shape (K, P)
        For each experiment, see `linear.Block`.
    parameters : sequence of Parameter
        The P parameters; the iteration starts at their flight values.
    known : Known, optional
        Used if the runs hold a single tone: then of all parameters of a run only lambda_2 is fitted.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    try:
        return _iterate(experiments, shares, parameters, known)
    except FitError as error:
        names = ", ".join(experiment.name for experiment in experiments)
        raise FitError(f"{names}: {error}") from error


def _iterate(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    known: Known | None,
) -> Outcome:
    centre = np.array([p.value for p in parameters])
    width = np.array([p.prior_sigma for p in parameters])
    theta, covariance = centre, np.zeros((centre.size, centre.size))
    models: list[NoiseModel | None] = [None] * len(experiments)
    for iteration in range(MAX_ITERATIONS):
        blocks, fitted = [], []
        for experiment, share, model in zip(experiments, shares, models, strict=True):
            of_run = share @ theta
            fitted.append(noise_model(experiment, of_run, share @ covariance @ share.T, model))
            sysid = experiment.sysid.spectra(dynamics.delays(of_run))
            blocks.append(linear.compress(sysid, fitted[-1], experiment.sysid.tau, share))
        if iteration < SETTLED:
            tone = _common_tone(blocks)
            lost, directions = linear.blind(linear.information(blocks, theta)[0], width)
            if tone is not None:
                lost |= _beyond(tone, shares[0])
            prior = linear.Prior(centre, np.diag(1 / width)[lost])
            if tone and known:
                prior, lost = _all_but_lambda_2(known, shares[0])
        solution = linear.minimise(blocks, prior, theta, width)
        sigma = np.sqrt(np.diag(solution.covariance))
        moved = float(np.max(np.abs(solution.theta - theta)[~lost] / sigma[~lost], initial=0.0))
        last = iteration == MAX_ITERATIONS - 1
        if iteration > 1 and moved < (HARMLESS if last else TOLERANCE):
            return Outcome(tuple(parameters), solution, lost, directions, tone, moved < TOLERANCE)
        step = 1.0 if iteration < SETTLED else 0.5  # lest weights and parameters swing against each other
        theta = theta + step * (solution.theta - theta)
        covariance, models = solution.covariance, list(fitted)
    raise FitError(f"parameters still move by {moved:.2g} sigma after {MAX_ITERATIONS} iterations")


def _common_tone(blocks: Sequence[linear.Block]) -> float | None:
    """Return the one frequency of all signals, 0 if there are none, else None."""
    if any(block.tone is None for block in blocks):
        return None
    tones = [block.tone for block in blocks if block.tone]
    if not tones:
        return 0.0
    return tones[0] if max(tones) < np.sqrt(2) * min(tones) else None


def _beyond(tone: float, share: Array) -> NDArray[np.bool_]:
    """Tell which parameters a single tone, or no signal at all, leaves undetermined."""
    names = ("lambda_2", "omega2_2") if tone else ("lambda_2", "C_2", "omega2_2")
    rows = [dynamics.PARAMETERS.index(name) for name in names]
    return np.asarray(np.any(share[rows] != 0, axis=0))


def _all_but_lambda_2(known: Known, share: Array) -> tuple[linear.Prior, NDArray[np.bool_]]:
    """Return what is known of a run, its gain excepted, as prior in the order of its own parameters."""
    others = np.arange(len(share)) != dynamics.PARAMETERS.index("lambda_2")
    root = np.linalg.cholesky(known.covariance[np.ix_(others, others)])
    return linear.Prior(share.T @ known.theta, np.linalg.inv(root) @ share[others]), share[others].any(axis=0)
