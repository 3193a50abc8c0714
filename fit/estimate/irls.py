"""Iteratively reweighted least squares (eq. irls) on one experiment or on many.

The paper divides by the previous residual, bin by bin; that leaves the estimates wider than their sigmas. The
weights here are a smooth PSD, fitted by likelihood to the residual of the adjacent noise run at the previous
estimate. The delays about which the commands are expanded move along, as far as noise can tell, until nothing
moves.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.estimate.hierarchy import Width
from fit.estimate.weighings import WARM_UP, Weighing, weighing
from fit.model import dynamics
from fit.paper import Parameter
from fit.parallel import parallel_map, progress_range
from fit.settings import Estimator
from fit.weighing import Experiment, linear, minimise

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
TOLERANCE = 1e-3  # sigma, least move that counts
HARMLESS = 0.05  # sigma, move that is put up with after MAX_ITERATIONS, and told
FREE = 10.0  # scales of the prior of a width, within which departures are held while weights settle
FASTER = 0.8  # of the iterations that are left, about, when one is done
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
class Rule:
    """When an iteration ends.

    Attributes
    ----------
    most : int
        Iterations.
    tolerance : float
        Least move [sigma] that counts.
    harmless : float
        Move [sigma] that is put up with in the last of them, and told.
    warm_up : int
        Iteration up to which nothing ends.
    windowed : bool
        Whether sigma is that of the estimate, or that of the curvature, which takes bins as independent.
    moving : str
        What does not settle, for messages.
    """

    most: int
    tolerance: float
    harmless: float
    warm_up: int = WARM_UP
    windowed: bool = False
    moving: str = "parameters still move"


@dataclass(frozen=True)
class Held:
    """What is known beside the data.

    Attributes
    ----------
    prior : linear.Prior
        As rows of chi^2.
    lost : ndarray of bool, shape (P,)
        True for indeterminable parameters.
    directions : ndarray, shape (K, P)
        See `linear.blind`.
    tone : float or None
        See `Outcome`.
    """

    prior: linear.Prior
    lost: NDArray[np.bool_]
    directions: Array
    tone: float | None


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
    departing : tuple of Width
        The widths, and which parameters depart by them.
    by_data : bool
        Whether the data chose what departs, not the settings.
    log_widths : tuple of tuple of float
        Mean and standard deviation of the logarithm of each of the widths.
    """

    parameters: tuple[Parameter, ...]
    solution: linear.Solution
    lost: NDArray[np.bool_]
    directions: Array
    tone: float | None
    converged: bool
    blocks: tuple[linear.Block, ...]
    prior: linear.Prior
    scatter: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    departing: tuple[Width, ...] = ()
    by_data: bool = False
    log_widths: tuple[tuple[float, float], ...] = ()

    @property
    def shared(self) -> int:
        """Number of the parameters that are no departures; they come first."""
        return min((min(width.members) for width in self.departing), default=len(self.parameters))

    @property
    def held(self) -> linear.Prior:
        """The prior, and departures within their likeliest widths: without, they and what is common blur."""
        rows = [self.prior.rows]
        for width, (log_width, _) in zip(self.departing, self.log_widths, strict=True):
            own = np.zeros((len(width.members), len(self.parameters)))
            own[range(len(own)), list(width.members)] = 1 / (np.exp(log_width) * width.units)
            rows.append(own)
        return linear.Prior(self.prior.centre, np.concatenate(rows))


def reweight(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    known: Known | None = None,
    *,
    estimator: Estimator = "gaussian",
    departing: Sequence[Width] = (),
    begun: Mapping[str, linear.Block] | None = None,
) -> Outcome:
    """Iterate weights, delays and parameters until no determinable parameter moves.

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
        ``flscov``, or the likelihood of the residual, see `fit.weighing.likelihood`.
    departing : sequence of Width
        Departures of experiments, held so weakly here that the data tell them.
    begun : mapping of str to linear.Block, optional
        Experiments, by name, as another fit has weighed them: where the iteration begins.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    first = begun or {}
    weighings = [
        weighing(e, share, estimator, first.get(e.name)) for e, share in zip(experiments, shares, strict=True)
    ]

    def held(blocks: Sequence[linear.Block], theta: Array, more: Array) -> Held:
        found = weakly_held(blocks, theta, parameters, shares[0], more)
        if not (found.tone and known):
            return found
        prior, lost = _all_but_lambda_2(known, shares[0])
        return replace(found, prior=prior, lost=lost)

    try:
        return iterate(weighings, parameters, held, departing=departing)
    except FitError as error:
        names = ", ".join(experiment.name for experiment in experiments)
        raise FitError(f"{names}: {error}") from error


def weakly_held(
    blocks: Sequence[linear.Block],
    theta: Array,
    parameters: Sequence[Parameter],
    share: Array,
    more: Array,
) -> Held:
    """Hold by its weak prior whatever the data do not determine; `more` are rows of chi^2 beside them."""
    width, tone = np.array([p.prior_sigma for p in parameters]), common_tone(blocks)
    lost, directions = linear.blind(linear.information(blocks, theta) + more.T @ more, width)
    if tone is not None:
        lost |= beyond(tone, share)
    prior = linear.Prior(np.array([p.value for p in parameters]), np.diag(1 / width)[lost])
    return Held(prior, lost, directions, tone)


def iterate(
    weighings: Sequence[Weighing],
    parameters: Sequence[Parameter],
    held: Callable[[Sequence[linear.Block], Array, Array], Held],
    rule: Rule | None = None,
    departing: Sequence[Width] = (),
    admitted: Callable[[Array, Array], Array] = lambda _, to: to,
) -> Outcome:
    """Iterate weights, delays and parameters; every fit and the forecast go through here.

    Parameters
    ----------
    weighings : sequence of Weighing
        One for each run.
    parameters : sequence of Parameter
        The P parameters; the iteration starts at their values.
    held : callable
        Tells from blocks, theta and what holds the departures what is known beside the data.
    rule : Rule, optional
        When to stop.
    departing : sequence of Width
        Departures of experiments, see `reweight`.
    admitted : callable
        Tells from an estimate and the next one how far to go.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    rule = rule or Rule(MAX_ITERATIONS, TOLERANCE, HARMLESS)
    width = np.array([p.prior_sigma for p in parameters])
    theta, covariance = np.array([p.value for p in parameters]), np.zeros((width.size, width.size))
    of_departures = np.concatenate([np.empty((0, theta.size)), *(_rows(w, theta.size) for w in departing)])
    step, move_before = 1.0, np.zeros(theta.size)
    for iteration in range(rule.most):
        with progress_range(1 - FASTER**iteration, 1 - FASTER ** (iteration + 1)):
            weighed = partial(_weighed, theta=theta, covariance=covariance, iteration=iteration)
            blocks = parallel_map(weighed, weighings)
        if iteration < SETTLED:
            beside = held(blocks, theta, of_departures)
        determined = ~beside.lost
        prior = linear.Prior(beside.prior.centre, np.concatenate([beside.prior.rows, of_departures]))
        found = minimise(blocks, prior, theta, width)
        covariance = _spread(blocks, prior, found, width, rule)
        move = (found - theta) / np.sqrt(np.diag(covariance))
        moved = float(np.max(np.abs(move[determined]), initial=0.0))
        settled = moved < rule.tolerance and all(w.settled for w in weighings)
        put_up_with = iteration == rule.most - 1 and moved < rule.harmless
        if iteration > rule.warm_up and (settled or put_up_with):
            solution = linear.solution(blocks, prior, found, width)
            state = (beside.lost, beside.directions, beside.tone, settled, tuple(blocks), beside.prior)
            return Outcome(tuple(parameters), solution, *state, departing=tuple(departing))
        if iteration >= SETTLED and float(move[determined] @ move_before[determined]) < 0:
            step /= 2  # lest weights and parameters swing against each other
        move_before = move
        theta = admitted(theta, theta + step * (found - theta))
    most = parameters[int(np.argmax(np.where(determined, np.abs(move), 0.0)))].name
    raise FitError(f"{rule.moving} by {moved:.2g} sigma after {rule.most} iterations, {most} most")


def _weighed(weighing: Weighing, theta: Array, covariance: Array, iteration: int) -> linear.Block:
    return weighing.block(theta, covariance, iteration)


def _spread(
    blocks: Sequence[linear.Block], prior: linear.Prior, theta: Array, width: Array, rule: Rule
) -> Array:
    """Return the covariance in whose sigmas moves count, shape (P, P)."""
    if rule.windowed:
        covariance = linear.solution(blocks, prior, theta, width).covariance
    else:
        covariance = linear.curvature_covariance(linear.information(blocks, theta), prior, width)
    if not np.all(np.diag(covariance) > 0):
        raise FitError("ill-conditioned beyond what numbers hold; expected channels in the units they name")
    return covariance


def _rows(width: Width, size: int) -> Array:
    """Return what holds the departures of a width while weights settle, as rows of a `linear.Prior`."""
    return np.eye(size)[list(width.members)] / (FREE * width.scale * width.units[:, None])


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
