"""Iteratively reweighted least squares (Eq. (7)) on one experiment or on many.

The paper divides by the previous residual, bin by bin; that leaves the estimates wider than their sigmas. The
weights here are a smooth PSD, fitted by likelihood to the residual of the adjacent noise run at the previous
estimate. The delays about which the commands are expanded move along, as far as noise permits, until nothing
moves.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting import constraints
from fit.fitting.joint_model import (
    JointModel,
    Prior,
    free_directions,
    lmfit_symbol,
    parameter_values,
    prior_rows,
)
from fit.fitting.null_space import NullSpace, null_space
from fit.fitting.random_effects import FREE, ScaleParameter, n_shared
from fit.fitting.run_estimate import RunEstimate, run_estimate
from fit.fitting.solved_model import SolvedModel
from fit.fitting.weighings import WARM_UP, LTPDAWeighing, SmoothWeighing, Weighing
from fit.parallel import parallel_map, progress_range
from fit.parameters import Parameter
from fit.results import Estimate
from fit.settings import Estimator
from fit.whitening import Experiment, whitened_run

if TYPE_CHECKING:
    import lmfit
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

    def error(self, parameters: Sequence[Parameter], move: Array) -> FitError:
        """Return the error of an iteration whose last step moved the parameters by `move` [sigma], (P,)."""
        name, n = parameters[int(np.argmax(move))].name, self.max_iterations
        return FitError(f"{self.moving} by {move.max():.2g} sigma after {n} iterations, {name} most")


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
    model : JointModel
        The runs, compressed, as lmfit has minimised them last.
    result : MinimizerResult
        What lmfit made of them; departures within the weak priors that hold them while weights settle.
    stated : lmfit.Parameters
        Where the iteration began, with what is known of the parameters without any weak prior.
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
    model: JointModel
    result: MinimizerResult
    stated: lmfit.Parameters
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
    def solved(self) -> SolvedModel:
        """The runs, compressed, with what lmfit made of them."""
        weak = tuple(Prior(p.value, p.prior_sigma) for p in self.parameters)
        return SolvedModel(self.model, self.result, weak)

    @property
    def free(self) -> Array:
        """The directions in which the parameters vary, shape (P, F)."""
        return free_directions(self.result.params)

    @property
    def exact(self) -> NDArray[np.bool_]:
        """Which parameters are fixed, or tied to fixed ones alone, shape (P,)."""
        return np.asarray(~self.free.any(axis=1))

    @property
    def constraints(self) -> dict[int, str]:
        """What is stated of parameters, in words, by their place; departures left out."""
        words = {i: constraints.text(p) for i, p in enumerate(self.stated.values()) if i < self.shared}
        names = {p.name: lmfit_symbol(p.name) for p in self.parameters if "." in p.name}
        for name, symbol in names.items():  # of FMUs
            words = {i: re.sub(rf"\b{symbol}\b", name, text) for i, text in words.items()}
        return {i: text for i, text in words.items() if text}

    def bounds(self, theta: Array | None = None) -> dict[int, float]:
        """Return the bounds that estimates theta, shape (P,), are at; by default those of the fit."""
        params = self.result.params if theta is None else constraints.params_at(self.result.params, theta)
        at_bound = constraints.at_bound(params, self.solution.sigma)
        return {i: bound for i, bound in at_bound.items() if not self.undetermined[i]}

    def estimates(
        self,
        names: Mapping[int, str],
        values: Array | None = None,
        covariance: Array | None = None,
    ) -> tuple[dict[str, Estimate], Array]:
        """Return estimates as results have them, and their covariance, shape (N, N).

        Parameters
        ----------
        names : mapping of int to str
            By place of the N parameters that are reported, their names in the results.
        values, covariance : ndarray, shapes (N,) and (N, N), optional
            Other estimates of these N than those of least squares, such as unattenuated ones.

        Raises
        ------
        FitError
            If a sigma is no positive number.
        """
        places, theta = list(names), self.solution.theta.copy()
        if values is not None:
            theta[places] = values
        if covariance is None:
            covariance = self.solution.covariance[np.ix_(places, places)]
        sigma = np.sqrt(np.diag(covariance))
        if not np.all((np.isfinite(sigma) & (sigma > 0)) | self.exact[places]):
            raise FitError("a sigma is not a positive number")
        words, bounds = self.constraints, self.bounds(theta)
        for i, bound in bounds.items():
            words[i] = re.sub("bounds .*", f"at bound {bound:.9g}", words[i])
        estimates = {
            names[i]: Estimate(float(theta[i]), s, self.parameters[i].unit, constraint=words.get(i, ""))
            for i, s in zip(places, sigma.tolist(), strict=True)
        }
        return estimates, covariance


def reweight(
    experiments: Sequence[Experiment],
    shares: Sequence[Array],
    parameters: Sequence[Parameter],
    *,
    estimator: Estimator = "gaussian",
    random_effects: Sequence[ScaleParameter] = (),
    initial: Mapping[str, whitened_run.WhitenedRun] | None = None,
    params: lmfit.Parameters | None = None,
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
    params : lmfit.Parameters, optional
        Where the iteration starts, and what is known of the parameters, see `iterate`.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    weighings: list[Weighing] = []
    for e, share in zip(experiments, shares, strict=True):
        if estimator == "flscov":
            weighings.append(LTPDAWeighing(e, share))
        else:
            weighings.append(SmoothWeighing(e, share, estimator, (initial or {}).get(e.name)))
    try:
        return iterate(weighings, parameters, params, random_effects=random_effects)
    except FitError as error:
        names = ", ".join(experiment.name for experiment in experiments)
        raise FitError(f"{names}: {error}") from error


def iterate(
    weighings: Sequence[Weighing],
    parameters: Sequence[Parameter],
    params: lmfit.Parameters | None = None,
    convergence: Convergence | None = None,
    random_effects: Sequence[ScaleParameter] = (),
    limit_step: Callable[[Array, Array], Array] = lambda _, target: target,
    weak_priors: Callable[[Array, Array], tuple[NullSpace, Mapping[int, Prior]]] | None = None,
) -> IRLSResult:
    """Iterate weights, delays and parameters, for fits and forecasts.

    Parameters
    ----------
    weighings, parameters : sequence of Weighing, sequence of Parameter
        Of the runs, and the P parameters.
    params : lmfit.Parameters, optional
        Where the iteration starts and what is known, see `constraints.params`; by default their values.
    convergence, random_effects : Convergence, sequence of ScaleParameter, optional
        When to stop, and departures of experiments, see `reweight`.
    limit_step : callable
        Returns how far to go from an estimate towards the next one.
    weak_priors : callable, optional
        Of information, (P, P), and free directions, (P, F), returns what is not determined and the weak
        priors, by default of that, about the values of `parameters`.

    Raises
    ------
    FitError
        If it does not settle, or a step of it fails.
    """
    convergence = convergence or Convergence(MAX_ITERATIONS, TOLERANCE, HARMLESS)
    weak_priors = weak_priors or partial(_weak_priors, parameters)
    stated = constraints.params(parameters) if params is None else params
    stated = _with_priors(stated, {i: p for w in random_effects for i, p in w.priors(FREE * w.scale).items()})
    known = prior_rows(stated)[0]
    theta, covariance = parameter_values(stated), np.zeros((len(parameters), len(parameters)))
    step, move_before = 1.0, np.zeros(theta.size)
    for iteration in range(convergence.max_iterations):
        with progress_range(1 - FASTER**iteration, 1 - FASTER ** (iteration + 1)):
            whitened_runs, estimates = _weighed(weighings, theta, covariance, iteration)
        start = constraints.params_at(stated, theta)
        if iteration < FIXED_SET:
            information = whitened_run.information(whitened_runs, theta) + known.T @ known
            blind, weak = weak_priors(information, free_directions(start))
        determined = ~blind.undetermined
        model = JointModel(estimates)
        result = model.fit(_with_priors(start, weak))
        estimate, covariance = parameter_values(result.params), _covariance(model, result)
        move = whitened_run.in_sigma(estimate - theta, covariance)
        largest = float(np.max(np.abs(move[determined]), initial=0.0))
        converged = largest < convergence.tolerance and all(run.converged for run in weighings)
        ended = converged or (iteration == convergence.max_iterations - 1 and largest < convergence.max_move)
        if ended and iteration > convergence.warm_up:
            solution = _solution(whitened_runs, model, result)
            state = (*blind, converged, whitened_runs, model, result, stated)
            return IRLSResult(tuple(parameters), solution, *state, random_effects=tuple(random_effects))
        swings = float(move[determined] @ move_before[determined]) < 0  # against the weights
        step, move_before = step / 2 if iteration >= FIXED_SET and swings else step, move
        theta = limit_step(theta, theta + step * (estimate - theta))
    raise convergence.error(parameters, np.where(determined, np.abs(move), 0.0))


def _with_priors(params: lmfit.Parameters, priors: Mapping[int, Prior]) -> lmfit.Parameters:
    """Return parameters with priors of those, by their place, that vary and have none."""
    known = params.copy()
    for i, p in enumerate(known.values()):
        if i in priors and p.vary and p.user_data is None:
            p.user_data = priors[i]
    return known


def _weak_priors(
    parameters: Sequence[Parameter], information: Array, free: Array
) -> tuple[NullSpace, dict[int, Prior]]:
    """Return what the data do not determine, and its weak priors."""
    blind = null_space(information, np.array([p.prior_sigma for p in parameters]), free)
    priors = {i: Prior(p.value, p.prior_sigma) for i, p in enumerate(parameters) if blind.undetermined[i]}
    return blind, priors


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
    whitened_runs: Sequence[whitened_run.WhitenedRun], model: JointModel, result: MinimizerResult
) -> whitened_run.Solution:
    covariance = _covariance(model, result)
    # 1 for what the data determine, 0 for what a prior does; more where the PSD adds to the covariance
    shares = np.linalg.eigvals(covariance @ model.information(result.params)).real
    n_determined = float(np.sum(np.clip(shares, 0, 1)))
    return solution(whitened_runs, parameter_values(result.params), covariance, n_determined)


def _covariance(model: JointModel, result: MinimizerResult) -> Array:
    covariance = model.covariance(result.params)
    if not np.all((np.diag(covariance) > 0) | ~free_directions(result.params).any(axis=1)):
        raise FitError("ill-conditioned beyond what numbers hold; expected channels in the units they name")
    return covariance


def refit(outcome: IRLSResult, whitened_runs: Sequence[whitened_run.WhitenedRun]) -> IRLSResult:
    """Return the outcome with its runs weighed anew, all else known being what it was."""
    named = zip(outcome.model.runs, whitened_runs, strict=True)
    model = JointModel([run_estimate(run.name, block) for run, block in named])
    result = model.fit(outcome.result.params)
    solution = _solution(whitened_runs, model, result)
    return replace(outcome, solution=solution, whitened_runs=tuple(whitened_runs), model=model, result=result)
