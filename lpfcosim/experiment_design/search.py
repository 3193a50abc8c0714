"""The search for a few tones within the limits that come near the bound."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign, DesignSpec
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import convex_bound, limits, multisine, tones
from lpfcosim.experiment_design.convex_bound import Optimum
from lpfcosim.experiment_design.design_problem import DesignProblem, with_tones
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.inertial_design import InertialDesign
from lpfcosim.experiment_design.initial_guess import add_harmonics, initial_tones
from lpfcosim.experiment_design.multisine import Multisine, Solution, ToneWindow
from lpfcosim.experiment_design.tones import Tone

Array = NDArray[np.float64]

N_STARTS = 3  # beginnings, of which the best is kept
N_TIGHTENINGS = 3  # times that limits are tightened by what transients add
SETTLING_TIME = 600.0  # s that a run goes on after its tones: what follows them is checked as well
FLANK, RAMP = 0.05, 1080.0  # share of a run under a flank of the window; s, longest rise of a tone
N_EXCHANGES = 4  # times that other tones are tried beside those there are
BOUND_SHARE, COMPOSE_SHARE, EXCHANGE_SHARE, TONES_SHARE = (
    0.05,
    0.4,
    0.6,
    0.8,
)  # shares of the time, done after what they name
SHORT_RAMP = 300.0  # s, where rms is what counts: tones clear of the flanks make the most of it


@dataclass(frozen=True)
class SearchProgress:
    """Callbacks of the search.

    Attributes
    ----------
    on_bound : callable
        Of value and bound of the programme.
    on_value : callable
        Of a step of the search, and of the objective that its tones reach.
    on_share : callable
        Of the share of the work that is done, from 0 to 1.
    """

    on_bound: Callable[[float, float], None]
    on_value: Callable[[str, float], None]
    on_share: Callable[[float], None]

    def subrange(self, begin: float, end: float) -> "SearchProgress":
        """Return the same for a part of the work, from one share of it to another."""
        return replace(self, on_share=lambda share: self.on_share(begin + share * (end - begin)))


@dataclass(frozen=True)
class Design:
    """A design.

    Attributes
    ----------
    problem : Problem
        What was sought.
    optimum : Optimum
        The best power, and the bound.
    solution : Score
        Tones that come near.
    tones : mapping of str to tuple of Tone
        By experiment.
    campaign : Campaign
        With these tones.
    sigmas_after : mapping of str to float
        Sigmas to expect of it.
    limit_ratios : mapping of str to mapping of str to float
        By experiment and limit, what is reached in units of the limit, in the time domain.
    sigma_bounds : mapping of str to float
        By parameter, the sigma that no design within the limits goes below.
    complete : bool
        False if the search was interrupted; `sigma_bounds` is then left out.
    min_duration : float, optional
        Hours that were sought: what no design of the same experiments needs less than [s].
    angles : Angles, optional
        What becomes of the inertial calibration, where its angles are sought.
    """

    problem: DesignProblem
    optimum: Optimum
    solution: Solution
    tones: Mapping[str, tuple[Tone, ...]]
    campaign: Campaign
    sigmas_after: Mapping[str, float]
    limit_ratios: Mapping[str, Mapping[str, float]]
    sigma_bounds: Mapping[str, float]
    complete: bool
    min_duration: float | None = None
    angles: InertialDesign | None = None

    @property
    def ratios(self) -> dict[str, float]:
        """Sigmas to expect over those wanted, of the parameters that count and are determined."""
        problem = self.problem
        scale = problem.experiments[0].scale[problem.objective.indices].tolist()
        return {
            n: self.sigmas_after[n] / s
            for n, s in zip(problem.parameters, scale, strict=True)
            if n in self.sigmas_after
        }

    @property
    def duration(self) -> float:
        """Time that the experiments with tones take [s]."""
        return sum(experiment.model.duration for experiment in self.problem.experiments)

    @property
    def value(self) -> float:
        """The objective by the forecast of the new campaign."""
        ratios = [self.ratios.get(name, np.inf) for name in self.problem.parameters]
        return self.problem.objective.value(np.log(ratios))

    @property
    def efficiency(self) -> float:
        """The bound of the objective over what was reached."""
        return self.optimum.bound / self.value


def search(problem: DesignProblem, fit_model: FitModel, progress: SearchProgress) -> Design:
    """Return the best tones that are found; interrupted, the best so far.

    Raises
    ------
    InputError
        If ``no_worse`` cannot be reached.
    KeyboardInterrupt
        If it comes before any tones are found.
    """
    spec = problem.plan.design
    _check_reach(problem, spec)
    optimum = convex_bound.optimize_power(
        problem.experiments, problem.prior_information, problem.objective, spec.forbidden, progress.on_bound
    )
    progress.on_share(BOUND_SHARE)
    solution, complete = None, True
    try:
        for solution in _improve(problem, optimum, progress.subrange(BOUND_SHARE, TONES_SHARE)):  # noqa: B007 - the last one is wanted
            pass
    except KeyboardInterrupt:
        complete = False
        if solution is None:
            raise
    assert solution is not None
    scaled = _scale_to_limits(problem, solution)
    return _design(
        problem, fit_model, optimum, scaled, progress.subrange(TONES_SHARE, 1.0), complete=complete
    )


def _design(
    problem: DesignProblem,
    fit_model: FitModel,
    optimum: Optimum,
    solution: Solution,
    progress: SearchProgress,
    *,
    complete: bool,
) -> Design:
    tones_of = {
        multisine.experiment.run.experiment: tones.describe_tones(
            multisine, solution.information, problem.objective.indices.tolist(), problem.names
        )
        for multisine in solution.multisines
    }
    campaign = with_tones(
        problem.plan, {name: tuple(t.injection for t in designed) for name, designed in tones_of.items()}
    )
    return Design(
        problem=problem,
        optimum=optimum,
        solution=solution,
        tones=tones_of,
        campaign=campaign,
        sigmas_after=fit_model.sigmas(campaign),
        limit_ratios=_limit_ratios(problem, campaign),
        sigma_bounds=_sigma_bounds(problem, optimum, progress) if complete else {},
        complete=complete,
    )


def _check_reach(problem: DesignProblem, spec: DesignSpec) -> None:
    """Refuse ratios of sigmas that no design reaches, and report the nearest."""
    objective = problem.objective
    if not np.isfinite(objective.max_ratios).all():
        return
    plain = replace(objective, minimax=True, max_ratios=np.full(objective.max_ratios.size, np.inf))
    nearest = convex_bound.optimize_power(
        problem.experiments, problem.prior_information, plain, spec.forbidden
    )
    if nearest.bound > float(objective.max_ratios.min()):
        logs = objective.logs(nearest.information)
        held_up = problem.parameters[int(np.argmax(logs))]
        raise InputError(
            f"design.no_worse: {objective.max_ratios.min():g} is beyond reach, within the limits some sigma "
            f"stays at {nearest.bound:.3g} times the goal; {held_up} is among those that limit"
        )


def _sigma_bounds(problem: DesignProblem, optimum: Optimum, progress: SearchProgress) -> dict[str, float]:
    """Return, by parameter, a sigma that no design within the limits goes below, even for it alone."""
    objective, bounds = problem.objective, {}
    values = convex_bound.single_parameter_bounds(
        problem.experiments, problem.prior_information, objective, optimum, problem.plan.design.forbidden
    )
    for i, name, value in zip(objective.indices, problem.parameters, values, strict=True):
        bounds[name] = value * float(problem.experiments[0].scale[i])
        progress.on_share(len(bounds) / len(problem.parameters))
    return bounds


def _tone_window(experiment: DesignedExperiment) -> ToneWindow:
    """Return when the tones of an experiment are on."""
    duration = experiment.model.duration
    flank = FLANK * duration
    if not any(limit.is_peak_limit for limit in experiment.active_limits):
        start = round(max(flank - SHORT_RAMP, 0.0))
        return ToneWindow(start, duration - max(start, SETTLING_TIME), min(SHORT_RAMP, flank))
    return ToneWindow(0.0, duration - SETTLING_TIME, min(flank, RAMP))


class _Steps:
    """Reports the value after each of a number of steps."""

    def __init__(self, progress: SearchProgress, name: str, number: int) -> None:
        self._progress, self._name, self._number, self._made = progress, name, number, 0

    def __call__(self, value: float) -> None:
        self._made += 1
        self._progress.on_value(self._name, value)
        self._progress.on_share(self._made / self._number)


def _improve(problem: DesignProblem, optimum: Optimum, progress: SearchProgress) -> Iterator[Solution]:
    """Yield few tones at the limits: the best of several starts and exchanges, then with tightened limits."""
    best_solution: Solution | None = None
    total = TONES_SHARE - BOUND_SHARE
    active_limits = [limit for experiment in problem.experiments for limit in experiment.active_limits]
    n_exchanges = N_EXCHANGES if any(limit.is_peak_limit for limit in active_limits) else 0
    compose = COMPOSE_SHARE if n_exchanges else EXCHANGE_SHARE
    shares = [0.0, (compose - BOUND_SHARE) / total, (EXCHANGE_SHARE - BOUND_SHARE) / total, 1.0]
    starts, exchanges, tightenings = (progress.subrange(*share) for share in pairwise(shares))
    for n_start in range(N_STARTS):
        solution = _start(
            problem, optimum, n_start, starts.subrange(n_start / N_STARTS, (n_start + 1) / N_STARTS)
        )
        if best_solution is None or solution.value < best_solution.value:
            best_solution = solution
        yield best_solution
    assert best_solution is not None
    for n in range(n_exchanges):
        solution = _exchange(
            problem, best_solution, n, exchanges.subrange(n / n_exchanges, (n + 1) / n_exchanges)
        )
        if solution.value < best_solution.value:
            best_solution = solution
        yield best_solution
    for n in range(N_TIGHTENINGS):
        ratios = [_ratios(multisine) for multisine in best_solution.multisines]
        tightened = tuple(
            replace(multisine, margins=multisine.margins / np.where(reached > 0.9, reached, 1.0))
            for multisine, reached in zip(best_solution.multisines, ratios, strict=True)
        )
        subrange = tightenings.subrange(n / N_TIGHTENINGS, (n + 1) / N_TIGHTENINGS)
        step = _Steps(subrange, f"in the time domain, {n + 1} of {N_TIGHTENINGS}", 1)
        best_solution = multisine.polish(tightened, problem.base_information, problem.objective, step)
        yield best_solution


def _start(problem: DesignProblem, optimum: Optimum, n_start: int, progress: SearchProgress) -> Solution:
    """Return few tones from one initial guess."""
    spec, windows = problem.plan.design, [_tone_window(experiment) for experiment in problem.experiments]
    generator = np.random.default_rng([problem.plan.seed, n_start])
    step = _Steps(progress, f"trial {n_start + 1} of {N_STARTS}", multisine.steps(spec.sines))
    multisines = initial_tones(
        problem.experiments, windows, optimum, spec.forbidden, spec.spacing, n_start, generator
    )
    return multisine.compose(multisines, problem.base_information, problem.objective, spec.sines, step)


def _exchange(problem: DesignProblem, solution: Solution, n: int, progress: SearchProgress) -> Solution:
    """Return few tones after all other harmonics have joined."""
    spec = problem.plan.design
    generator = np.random.default_rng([problem.plan.seed, N_STARTS, n])
    step = _Steps(progress, f"other tones, {n + 1} of {N_EXCHANGES}", 3)
    multisines = [add_harmonics(multisine, spec.forbidden, generator) for multisine in solution.multisines]
    return multisine.exchange(multisines, problem.base_information, problem.objective, spec.sines, step)


def _scale_to_limits(problem: DesignProblem, solution: Solution) -> Solution:
    """Return the same tones, as large as limits in the time domain allow."""
    multisines = tuple(
        replace(multisine, amplitudes=multisine.amplitudes / _ratios(multisine).max())
        for multisine in solution.multisines
    )
    return multisine.evaluate(multisines, problem.base_information, problem.objective)


def _ratios(multisine: Multisine) -> Array:
    """Return how far the tones of an experiment reach each of its limits in the time domain."""
    experiment = multisine.experiment
    run = replace(experiment.run, injections=tones.injections(multisine))
    ratios = limits.limit_ratios(run, experiment.active_limits, limits.tone_response(run))
    return np.array([ratios[limit.name] for limit in experiment.active_limits])


def _limit_ratios(problem: DesignProblem, campaign: Campaign) -> dict[str, dict[str, float]]:
    runs = {run.experiment: run for run in campaign.runs if run.kind == "sysid"}
    return {
        experiment.run.experiment: limits.limit_ratios(
            runs[experiment.run.experiment],
            experiment.active_limits,
            limits.tone_response(runs[experiment.run.experiment]),
        )
        for experiment in problem.experiments
    }
