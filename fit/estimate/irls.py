"""Iteratively reweighted least squares (eq. irls) on one experiment or on many.

The paper divides by the previous residual, bin by bin; that leaves the estimates wider than their sigmas. The
weights here are a smooth PSD, fitted by likelihood to the residual of the adjacent noise run at the previous
estimate. The delays about which the commands are expanded move along, until nothing moves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.estimate import flscov, linear
from fit.estimate.likelihood import Likelihood
from fit.estimate.runs import Experiment, noise_model
from fit.estimate.scatter import Scatter, rows
from fit.model import dynamics
from fit.paper import Parameter
from fit.settings import Estimator
from fit.signal import NoiseModel

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
TOLERANCE = 1e-3  # sigma, least move that counts
HARMLESS = 0.05  # sigma, move that is put up with after MAX_ITERATIONS, and told
_WARM_UP = 1  # iteration up to which the signal may still be in the residual
SAME_WIDTH = 0.05  # sigma, move of the width of a scatter that does not count
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
    blocks : tuple of linear.Block
        The data as they were weighed last.
    prior : linear.Prior
        What was known beside them.
    scatter : mapping of str to tuple of float
        Width, and its sigma, by which a parameter scatters between experiments.
    """

    parameters: tuple[Parameter, ...]
    solution: linear.Solution
    lost: NDArray[np.bool_]
    directions: Array
    tone: float | None
    converged: bool
    blocks: tuple[linear.Block, ...]
    prior: linear.Prior
    scatter: Mapping[str, tuple[float, float]]


def reweight(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    known: Known | None = None,
    *,
    estimator: Estimator = "gaussian",
    scatter: Sequence[Scatter] = (),
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
    estimator : str
        ``flscov``, or the likelihood of the residual, see `fit.estimate.likelihood`.
    scatter : sequence of Scatter
        Departures of experiments from their common value, whose width is estimated along.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    try:
        return _iterate(experiments, shares, parameters, known, estimator, scatter)
    except FitError as error:
        names = ", ".join(experiment.name for experiment in experiments)
        raise FitError(f"{names}: {error}") from error


def _iterate(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    known: Known | None,
    estimator: Estimator,
    scatter: Sequence[Scatter],
) -> Outcome:
    centre = np.array([p.value for p in parameters])
    width = np.array([p.prior_sigma for p in parameters])
    theta, covariance = centre, np.zeros((centre.size, centre.size))
    weighings = [
        _Flscov(e, share) if estimator == "flscov" else _Smooth(e, share, estimator)
        for e, share in zip(experiments, shares, strict=True)
    ]
    widths = [(s.start, np.inf) for s in scatter]
    step, move_before = 1.0, np.zeros(theta.size)
    for iteration in range(MAX_ITERATIONS):
        blocks = [w.block(theta, covariance, iteration) for w in weighings]
        of_scatter = rows(scatter, theta.size, [width for width, _ in widths])
        if iteration < SETTLED:
            tone = common_tone(blocks)
            H = linear.information(blocks, theta) + of_scatter.T @ of_scatter
            lost, directions = linear.blind(H, width)
            if tone is not None:
                lost |= beyond(tone, shares[0])
            prior = linear.Prior(centre, np.diag(1 / width)[lost])
            if tone and known:
                prior, lost = _all_but_lambda_2(known, shares[0])
        beside = linear.Prior(prior.centre, np.concatenate([prior.rows, of_scatter]))
        found = linear.minimise(blocks, beside, theta, width)
        H = linear.information(blocks, found)
        spread = linear.curvature_covariance(H, beside, width)
        if not np.all(np.diag(spread) > 0):
            raise FitError(
                "ill-conditioned beyond what numbers hold; expected channels in the units they name"
            )
        move = (found - theta) / np.sqrt(np.diag(spread))
        moved = float(np.max(np.abs(move[~lost]), initial=0.0))
        before, widths = widths, _widths(scatter, widths, found, H + beside.rows.T @ beside.rows)
        still = all(abs(a - b) < SAME_WIDTH * e for (a, _), (b, e) in zip(before, widths, strict=True))
        settled = moved < TOLERANCE and still and all(w.settled for w in weighings)
        last = iteration == MAX_ITERATIONS - 1
        if iteration > _WARM_UP and (settled or (last and moved < HARMLESS)):
            return Outcome(
                parameters=tuple(parameters),
                solution=linear.solution(blocks, beside, found, width),
                lost=lost,
                directions=directions,
                tone=tone,
                converged=settled,
                blocks=tuple(blocks),
                prior=beside,
                scatter={s.name: width for s, width in zip(scatter, widths, strict=True)},
            )
        back = float(move[~lost] @ move_before[~lost]) < 0
        if iteration >= SETTLED and back:  # lest weights and parameters swing against each other
            step /= 2
        move_before = move
        theta = theta + step * (found - theta)
        covariance = spread
    raise FitError(f"parameters still move by {moved:.2g} sigma after {MAX_ITERATIONS} iterations")


def _widths(
    scatter: Sequence[Scatter], widths: Sequence[tuple[float, float]], theta: Array, H: Array
) -> list[tuple[float, float]]:
    """Estimate the widths anew, each with the others as they were; H holds them all."""
    found = []
    for s, (width, _) in zip(scatter, widths, strict=True):
        own = s.rows(theta.size, width)
        found.append(s.estimate(theta, H - own.T @ own, width))
    return found


class _Smooth:
    """Weighs a run by the smooth PSD of its noise run, and by what its own residual then is like."""

    def __init__(self, experiment: Experiment, share: Array, likelihood: Likelihood) -> None:
        self._experiment, self._share, self._likelihood = experiment, share, likelihood
        self._model: NoiseModel | None = None
        self.settled = True

    def block(self, theta: Array, covariance: Array, iteration: int) -> linear.Block:
        share, of_run, run = self._share, self._share @ theta, self._experiment.sysid
        self._model = noise_model(self._experiment, of_run, share @ covariance @ share.T, self._model)
        terms = run.spectra(dynamics.delays(of_run))
        # before the signal is subtracted, no residual can tell an outlier
        c = dynamics.coefficients(of_run, terms.tau) if iteration > _WARM_UP else None
        return linear.block(terms, self._model, share, likelihood=self._likelihood, c=c)


class _Flscov:
    """Weighs a run as LTPDA does."""

    def __init__(self, experiment: Experiment, share: Array) -> None:
        self._experiment, self._share = experiment, share
        self._total = 0.0
        self.settled = False

    def block(self, theta: Array, _: Array, iteration: int) -> linear.Block:
        of_run = self._share @ theta
        terms = self._experiment.sysid.columns(dynamics.delays(of_run))
        c = dynamics.coefficients(of_run, terms.tau) if iteration else None
        block, total = flscov.block(terms, self._share, c)
        self.settled = abs(total - self._total) < flscov.TOLERANCE * total
        self._total = total
        return block


def common_tone(blocks: Sequence[linear.Block]) -> float | None:
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


def _all_but_lambda_2(known: Known, share: Array) -> tuple[linear.Prior, NDArray[np.bool_]]:
    """Return what is known of a run, its gain excepted, as prior in the order of its own parameters."""
    others = np.arange(len(share)) != dynamics.PARAMETERS.index("lambda_2")
    root = np.linalg.cholesky(known.covariance[np.ix_(others, others)])
    return linear.Prior(share.T @ known.theta, np.linalg.inv(root) @ share[others]), share[others].any(axis=0)
