"""Iteratively reweighted least squares (eq. irls) on one experiment or on many.

The paper divides by the previous residual, bin by bin; that leaves the estimates wider than their sigmas. The
weights here are a smooth PSD, fitted by likelihood to the residual of the adjacent noise run at the previous
estimate. The delays about which the commands are expanded move along, as far as noise can tell, until nothing
moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting.hierarchy import ScaleParameter, n_shared
from fit.fitting.joint_model import JointModel, Prior, SolvedModel, parameter_values
from fit.fitting.priors import PriorSet, weak_priors
from fit.fitting.problem import Problem
from fit.fitting.run_estimate import RunEstimate, run_estimate
from fit.fitting.weighings import WARM_UP, Weighing, weighing
from fit.parallel import parallel_map, progress_range
from fit.parameters import Parameter
from fit.settings import Estimator, ParameterSettings
from fit.whitening import Experiment, whitened_run

if TYPE_CHECKING:
    from lmfit.minimizer import MinimizerResult

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
TOLERANCE = 1e-3  # sigma, least move that counts
HARMLESS = 0.05  # sigma, move that is tolerated after MAX_ITERATIONS, and told
FASTER = 0.8  # of the iterations that are left, about, when one is done
SETTLED = 6  # iterations after which the set of indeterminable parameters stays


@dataclass(frozen=True)
class Convergence:
    """Criterion of convergence of an iteration.

    Attributes
    ----------
    most : int
        Iterations.
    tolerance : float
        Least move [sigma] that counts.
    harmless : float
        Move [sigma] that is tolerated in the last of them, and told.
    warm_up : int
        Iteration up to which nothing ends.
    moving : str
        What does not converge, for messages.
    """

    most: int
    tolerance: float
    harmless: float
    warm_up: int = WARM_UP
    moving: str = "parameters still move"


@dataclass(frozen=True)
class IRLSResult:
    """What the iteration ends with.

    Attributes
    ----------
    parameters : tuple of Parameter
        The P parameters.
    solution : whitened_run.Solution
        The estimate.
    lost : ndarray of bool, shape (P,)
        True for indeterminable parameters.
    directions : ndarray, shape (K, P)
        See `null_space`.
    converged : bool
        Whether the last move was within TOLERANCE.
    blocks : tuple of whitened_run.WhitenedRun
        The data as they were weighed last.
    prior : whitened_run.Prior
        What was known beside them.
    model : JointModel or None
        The runs, compressed, as lmfit has minimised them last.
    result : MinimizerResult or None
        What lmfit made of them; departures within the weak priors that hold them while weights settle.
    problem : Problem or None
        Its parameters, as lmfit has them.
    scatter : mapping of str to tuple of float
        ScaleParameter, and its sigma, by which a parameter scatters between experiments.
    departing : tuple of ScaleParameter
        The widths, and which parameters depart by them.
    by_data : bool
        Whether the data chose what departs, not the settings.
    log_widths : tuple of tuple of float
        Mean and standard deviation of the logarithm of each of the widths.
    """

    parameters: tuple[Parameter, ...]
    solution: whitened_run.Solution
    lost: NDArray[np.bool_]
    directions: Array
    converged: bool
    blocks: tuple[whitened_run.WhitenedRun, ...]
    prior: whitened_run.Prior
    model: JointModel | None = None
    result: MinimizerResult | None = None
    problem: Problem | None = None
    scatter: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    departing: tuple[ScaleParameter, ...] = ()
    by_data: bool = False
    log_widths: tuple[tuple[float, float], ...] = ()

    @property
    def shared(self) -> int:
        """Number of the parameters that are no departures; they come first."""
        return n_shared(self.departing, len(self.parameters))

    @property
    def solved(self) -> SolvedModel | None:
        """The runs, compressed, with what lmfit made of them."""
        if self.model is None or self.result is None:
            return None
        weak = tuple(Prior(p.value, p.prior_sigma) for p in self.parameters)
        return SolvedModel(self.model, self.result, weak)

    def is_fixed(self, i: int) -> bool:
        """Return whether the user fixes a parameter, by its place."""
        return self.problem is not None and i in self.problem.settings and not self.problem.settings[i].vary

    @property
    def held(self) -> whitened_run.Prior:
        """The prior, and departures within their likeliest widths: without, they and what is common blur."""
        rows = [self.prior.rows]
        for width, (log_width, _) in zip(self.departing, self.log_widths, strict=True):
            own = np.zeros((len(width.members), len(self.parameters)))
            own[range(len(own)), list(width.members)] = 1 / (np.exp(log_width) * width.units)
            rows.append(own)
        return whitened_run.Prior(self.prior.centre, np.concatenate(rows))


def reweight(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    *,
    estimator: Estimator = "gaussian",
    departing: Sequence[ScaleParameter] = (),
    initial: Mapping[str, whitened_run.WhitenedRun] | None = None,
    settings: Mapping[str, ParameterSettings] | None = None,
) -> IRLSResult:
    """Iterate weights, delays and parameters until no determinable parameter moves.

    Parameters
    ----------
    experiments : sequence of Experiment
        To be fitted together.
    shares : sequence of ndarray, shape (K, P)
        For each experiment, see `linear.WhitenedRun`.
    parameters : sequence of Parameter
        The P parameters; the iteration starts at their flight values.
    estimator : str
        ``flscov``, or the likelihood of the residual, see `fit.whitening.likelihoods`.
    departing : sequence of ScaleParameter
        Departures of experiments, held so weakly here that the data tell them.
    initial : mapping of str to whitened_run.WhitenedRun, optional
        Experiments, by name, as another fit has weighed them: where the iteration begins.
    settings : mapping of str to ParameterSettings, optional
        What the user says of parameters, by name.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    initial = initial or {}
    weighings = [
        weighing(e, share, estimator, initial.get(e.name))
        for e, share in zip(experiments, shares, strict=True)
    ]

    try:
        return iterate(weighings, parameters, departing=departing, settings=settings)
    except FitError as error:
        names = ", ".join(experiment.name for experiment in experiments)
        raise FitError(f"{names}: {error}") from error


def iterate(
    weighings: Sequence[Weighing],
    parameters: Sequence[Parameter],
    priors: Callable[[Sequence[whitened_run.WhitenedRun], Array, Array], PriorSet] | None = None,
    convergence: Convergence | None = None,
    departing: Sequence[ScaleParameter] = (),
    admitted: Callable[[Array, Array], Array] = lambda _, to: to,
    settings: Mapping[str, ParameterSettings] | None = None,
) -> IRLSResult:
    """Iterate weights, delays and parameters; every fit and the forecast go through here.

    Parameters
    ----------
    weighings : sequence of Weighing
        Of the runs.
    parameters : sequence of Parameter
        The P parameters; the iteration starts at their values.
    priors : callable, optional
        See `weak_priors`, the default about the values of `parameters`.
    convergence : Convergence, optional
        When to stop.
    departing : sequence of ScaleParameter
        Departures of experiments, see `reweight`.
    admitted : callable
        Returns how far to go from an estimate towards the next one.
    settings : mapping of str to ParameterSettings, optional
        What the user says of parameters, by name.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    convergence = convergence or Convergence(MAX_ITERATIONS, TOLERANCE, HARMLESS)
    priors = priors or partial(weak_priors, parameters)
    problem = Problem(parameters, departing, settings)
    theta, covariance = problem.start(), np.zeros((len(parameters), len(parameters)))
    step, move_before = 1.0, np.zeros(theta.size)
    for iteration in range(convergence.most):
        with progress_range(1 - FASTER**iteration, 1 - FASTER ** (iteration + 1)):
            blocks, estimates = _weighed(weighings, theta, covariance, iteration)
        if iteration < SETTLED:
            known = priors(blocks, theta, problem.known(theta))
        determined = ~known.lost
        model = JointModel(estimates)
        result = model.fit(problem.params(theta, known.priors))
        estimate, covariance = parameter_values(result.params), problem.covariance(model, result.params)
        move = (estimate - theta) / np.sqrt(np.diag(covariance))
        moved = float(np.max(np.abs(move[determined]), initial=0.0))
        settled = moved < convergence.tolerance and all(w.settled for w in weighings)
        ended = settled or (iteration == convergence.most - 1 and moved < convergence.harmless)
        if ended and iteration > convergence.warm_up:
            solution = _solution(blocks, model, result, covariance)
            prior = problem.prior(result.params, known)
            state = (known.lost, known.directions, settled, blocks, prior, model, result)
            return IRLSResult(tuple(parameters), solution, *state, problem, departing=tuple(departing))
        swings = float(move[determined] @ move_before[determined]) < 0  # against the weights
        step, move_before = step / 2 if iteration >= SETTLED and swings else step, move
        theta = admitted(theta, theta + step * (estimate - theta))
    raise _unsettled(convergence, parameters, np.where(determined, np.abs(move), 0.0))


def _unsettled(convergence: Convergence, parameters: Sequence[Parameter], move: Array) -> FitError:
    """Return the error of an iteration whose last step moved the parameters by `move` [sigma], shape (P,)."""
    most = parameters[int(np.argmax(move))].name
    return FitError(
        f"{convergence.moving} by {move.max():.2g} sigma after {convergence.most} iterations, {most} most"
    )


def _weighed(
    weighings: Sequence[Weighing], theta: Array, covariance: Array, iteration: int
) -> tuple[tuple[whitened_run.WhitenedRun, ...], tuple[RunEstimate, ...]]:
    """Return the runs weighed at theta, and what each of them then says by itself."""
    single = len(weighings) == 1

    def weighed(weighing: Weighing) -> tuple[whitened_run.WhitenedRun, RunEstimate]:
        block = weighing.block(theta, covariance, iteration)
        return block, run_estimate(weighing.name, block, psd_error=single)

    blocks, estimates = zip(*parallel_map(weighed, weighings), strict=True)
    return blocks, estimates


def _solution(
    blocks: Sequence[whitened_run.WhitenedRun], model: JointModel, result: MinimizerResult, covariance: Array
) -> whitened_run.Solution:
    """Return the estimate with chi^2 and degrees of freedom of all data."""
    theta = parameter_values(result.params)
    residuals = [block.plain @ block.coefficients(theta) for block in blocks]
    determined = round(float(np.trace(covariance @ model.information(result.params))))
    dof = sum(block.size for block in blocks) - determined
    return whitened_run.Solution(theta, covariance, float(np.sum(np.concatenate(residuals) ** 2)), dof)


def refit(outcome: IRLSResult, blocks: Sequence[whitened_run.WhitenedRun]) -> IRLSResult:
    """Return the outcome with its runs weighed anew, all else known being what it was."""
    assert outcome.model and outcome.result and outcome.problem
    named = zip(outcome.model.runs, blocks, strict=True)
    single = len(blocks) == 1
    model = JointModel([run_estimate(run.name, block, psd_error=single) for run, block in named])
    result = model.fit(outcome.result.params)
    solution = _solution(blocks, model, result, outcome.problem.covariance(model, result.params))
    return replace(outcome, solution=solution, blocks=tuple(blocks), model=model, result=result)
