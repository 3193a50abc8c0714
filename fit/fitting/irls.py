"""Iteratively reweighted least squares (Eq. (7)) on one experiment or on many.

The paper divides by the previous residual, bin by bin; that leaves the estimates wider than their sigmas. The
weights here are a smooth PSD, fitted by likelihood to the residual of the adjacent noise run at the previous
estimate. The delays about which the commands are expanded move along, as far as noise permits, until nothing
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
from fit.fitting.joint_model import JointModel, Prior, free_directions, parameter_values
from fit.fitting.parameter_set import ParameterSet
from fit.fitting.priors import PriorSet, prior_rows, weak_priors
from fit.fitting.random_effects import ScaleParameter, n_shared
from fit.fitting.run_estimate import RunEstimate, run_estimate
from fit.fitting.solved_model import SolvedModel
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
HARMLESS = 0.05  # sigma, move that is tolerated after MAX_ITERATIONS, with a warning
FASTER = 0.8  # of the iterations that are left, about, when one is done
FIXED_SET = 6  # iterations after which the set of indeterminable parameters stays


@dataclass(frozen=True)
class Convergence:
    """Criterion of convergence of an iteration.

    Attributes
    ----------
    max_iterations : int
        Iterations.
    tolerance : float
        Least move [sigma] that counts.
    max_move : float
        Move [sigma] that is tolerated in the last of them, with a warning.
    warm_up : int
        Iteration up to which nothing ends.
    moving : str
        What does not converge, for messages.
    """

    max_iterations: int
    tolerance: float
    max_move: float
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
    undetermined : ndarray of bool, shape (P,)
        True for indeterminable parameters.
    directions : ndarray, shape (K, P)
        See `null_space`.
    converged : bool
        Whether the last move was within TOLERANCE.
    whitened_runs : tuple of whitened_run.WhitenedRun
        The data as they were weighed last.
    prior : whitened_run.Prior
        Prior knowledge of them.
    model : JointModel or None
        The runs, compressed, as lmfit has minimised them last.
    result : MinimizerResult or None
        What lmfit made of them; departures within the weak priors that hold them while weights settle.
    parameter_set : ParameterSet or None
        Its parameters, as lmfit has them.
    scatter : mapping of str to tuple of float
        ScaleParameter, and its sigma, by which a parameter scatters between experiments.
    random_effects : tuple of ScaleParameter
        The widths, and which parameters depart by them.
    data_driven : bool
        Whether the data chose what departs, not the settings.
    log_widths : tuple of tuple of float
        Mean and standard deviation of the logarithm of each of the widths.
    """

    parameters: tuple[Parameter, ...]
    solution: whitened_run.Solution
    undetermined: NDArray[np.bool_]
    directions: Array
    converged: bool
    whitened_runs: tuple[whitened_run.WhitenedRun, ...]
    prior: whitened_run.Prior
    model: JointModel | None = None
    result: MinimizerResult | None = None
    parameter_set: ParameterSet | None = None
    scatter: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    random_effects: tuple[ScaleParameter, ...] = ()
    data_driven: bool = False
    log_widths: tuple[tuple[float, float], ...] = ()

    @property
    def shared(self) -> int:
        """Number of the parameters that are no departures; they come first."""
        return n_shared(self.random_effects, len(self.parameters))

    @property
    def determined(self) -> dict[str, int]:
        """Positions of the parameters that the data determine, by name."""
        return {p.name: i for i, p in enumerate(self.parameters) if not self.undetermined[i]}

    @property
    def solved(self) -> SolvedModel | None:
        """The runs, compressed, with what lmfit made of them."""
        if self.model is None or self.result is None:
            return None
        weak = tuple(Prior(p.value, p.prior_sigma) for p in self.parameters)
        return SolvedModel(self.model, self.result, weak)

    @property
    def exact(self) -> NDArray[np.bool_]:
        """Which parameters are fixed, or tied to fixed ones alone, shape (P,)."""
        if self.result is None:
            return np.zeros(len(self.parameters), dtype=bool)
        return np.asarray(~free_directions(self.result.params).any(axis=1))

    @property
    def conditional_prior(self) -> whitened_run.Prior:
        """The prior, and departures within their likeliest widths: without, they and what is common blur."""
        rows = [self.prior.rows]
        for width, (log_width, _) in zip(self.random_effects, self.log_widths, strict=True):
            rows.append(prior_rows(width.priors(np.exp(log_width)), len(self.parameters)))
        return whitened_run.Prior(self.prior.centre, np.concatenate(rows))


def reweight(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    *,
    estimator: Estimator = "gaussian",
    random_effects: Sequence[ScaleParameter] = (),
    initial: Mapping[str, whitened_run.WhitenedRun] | None = None,
    settings: Mapping[str, ParameterSettings] | None = None,
) -> IRLSResult:
    """Iterate weights, delays and parameters until no determinable parameter moves.

    Parameters
    ----------
    experiments : sequence of Experiment
        To be fitted together.
    shares : sequence of ndarray, shape (K, P)
        For each experiment, see `whitened_run.WhitenedRun`.
    parameters : sequence of Parameter
        The P parameters; the iteration starts at their flight values.
    estimator : str
        ``flscov``, or the likelihood of the residual, see `fit.whitening.likelihoods`.
    random_effects : sequence of ScaleParameter
        Departures of experiments, with priors so weak that the data determine them.
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
        return iterate(weighings, parameters, random_effects=random_effects, settings=settings)
    except FitError as error:
        names = ", ".join(experiment.name for experiment in experiments)
        raise FitError(f"{names}: {error}") from error


def iterate(
    weighings: Sequence[Weighing],
    parameters: Sequence[Parameter],
    priors: Callable[[Sequence[whitened_run.WhitenedRun], Array, Array], PriorSet] | None = None,
    convergence: Convergence | None = None,
    random_effects: Sequence[ScaleParameter] = (),
    limit_step: Callable[[Array, Array], Array] = lambda _, target: target,
    settings: Mapping[str, ParameterSettings] | None = None,
) -> IRLSResult:
    """Iterate weights, delays and parameters, for fits and forecasts.

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
    random_effects : sequence of ScaleParameter
        Departures of experiments, see `reweight`.
    limit_step : callable
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
    parameter_set = ParameterSet(parameters, random_effects, settings)
    theta, covariance = parameter_set.start(), np.zeros((len(parameters), len(parameters)))
    step, move_before = 1.0, np.zeros(theta.size)
    for iteration in range(convergence.max_iterations):
        with progress_range(1 - FASTER**iteration, 1 - FASTER ** (iteration + 1)):
            whitened_runs, estimates = _weighed(weighings, theta, covariance, iteration)
        if iteration < FIXED_SET:
            known = priors(whitened_runs, theta, parameter_set.known(theta))
        determined = ~known.undetermined
        model = JointModel(estimates)
        result = model.fit(parameter_set.params(theta, known.priors))
        estimate, covariance = parameter_values(result.params), parameter_set.covariance(model, result.params)
        move = (estimate - theta) / np.sqrt(np.diag(covariance))
        largest = float(np.max(np.abs(move[determined]), initial=0.0))
        converged = largest < convergence.tolerance and all(run.converged for run in weighings)
        ended = converged or (iteration == convergence.max_iterations - 1 and largest < convergence.max_move)
        if ended and iteration > convergence.warm_up:
            solution = _solution(whitened_runs, parameter_set, model, result)
            prior, effects = parameter_set.prior(result.params, known), tuple(random_effects)
            state = (known.undetermined, known.directions, converged, whitened_runs, prior, model, result)
            return IRLSResult(tuple(parameters), solution, *state, parameter_set, {}, effects)
        swings = float(move[determined] @ move_before[determined]) < 0  # against the weights
        step, move_before = step / 2 if iteration >= FIXED_SET and swings else step, move
        theta = limit_step(theta, theta + step * (estimate - theta))
    raise _unsettled(convergence, parameters, np.where(determined, np.abs(move), 0.0))


def _unsettled(convergence: Convergence, parameters: Sequence[Parameter], move: Array) -> FitError:
    """Return the error of an iteration whose last step moved the parameters by `move` [sigma], shape (P,)."""
    name = parameters[int(np.argmax(move))].name
    n = convergence.max_iterations
    return FitError(f"{convergence.moving} by {move.max():.2g} sigma after {n} iterations, {name} most")


def _weighed(
    weighings: Sequence[Weighing], theta: Array, covariance: Array, iteration: int
) -> tuple[tuple[whitened_run.WhitenedRun, ...], tuple[RunEstimate, ...]]:
    """Return the runs weighed at theta, and what each of them then says by itself."""

    def weighed(weighing: Weighing) -> tuple[whitened_run.WhitenedRun, RunEstimate]:
        block = weighing.block(theta, covariance, iteration)
        return block, run_estimate(weighing.name, block)

    whitened_runs, estimates = zip(*parallel_map(weighed, weighings), strict=True)
    return whitened_runs, estimates


def solution(
    whitened_runs: Sequence[whitened_run.WhitenedRun], theta: Array, covariance: Array, n_determined: float
) -> whitened_run.Solution:
    """Return an estimate with chi^2 and degrees of freedom of all data."""
    residuals = [run.root_level @ run.coefficients(theta) for run in whitened_runs]
    dof = sum(run.size for run in whitened_runs) - round(n_determined)
    return whitened_run.Solution(theta, covariance, float(np.sum(np.concatenate(residuals) ** 2)), dof)


def _solution(
    whitened_runs: Sequence[whitened_run.WhitenedRun],
    parameter_set: ParameterSet,
    model: JointModel,
    result: MinimizerResult,
) -> whitened_run.Solution:
    covariance = parameter_set.covariance(model, result.params)
    # 1 for what the data determine, 0 for what a prior does; more where the PSD adds to the covariance
    shares = np.linalg.eigvals(covariance @ model.information(result.params)).real
    n_determined = float(np.sum(np.clip(shares, 0, 1)))
    return solution(whitened_runs, parameter_values(result.params), covariance, n_determined)


def refit(outcome: IRLSResult, whitened_runs: Sequence[whitened_run.WhitenedRun]) -> IRLSResult:
    """Return the outcome with its runs weighed anew, all else known being what it was."""
    assert outcome.model and outcome.result and outcome.parameter_set
    named = zip(outcome.model.runs, whitened_runs, strict=True)
    model = JointModel([run_estimate(run.name, block) for run, block in named])
    result = model.fit(outcome.result.params)
    return replace(
        outcome,
        solution=_solution(whitened_runs, outcome.parameter_set, model, result),
        whitened_runs=tuple(whitened_runs),
        model=model,
        result=result,
    )
