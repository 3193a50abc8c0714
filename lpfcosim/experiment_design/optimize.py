"""The design of a campaign: first authority, then durations, then tones."""

from dataclasses import replace

import numpy as np

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, RunError
from lpfcosim.experiment_design import authority_selection, duration_allocation, inertial_design
from lpfcosim.experiment_design.convex_bound import Optimum
from lpfcosim.experiment_design.design_problem import DesignProblem, design_problem
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.schedule import HOUR
from lpfcosim.experiment_design.search import Design, SearchProgress, search

MIN_WORST_RATIO = 0.99  # worst ratio from which on fewer hours are not worth another search
MAX_SEARCHES = 5  # for the least hours, at most
MAX_DURATION = 7.2e6  # s, the most that is tried where nothing is said
DURATION_MARGIN = 1.002  # of the hours that one search leads the next to expect
BISECTIONS = 8
PROBLEM_SHARE, AUTHORITY_SHARE = (
    0.05,
    0.3,
)  # shares of the time after which experiments and settings are there
SEARCH_SHARE = 0.5  # of what is left goes to one search, where it may be the last


def design(plan: Campaign, fit_model: FitModel, progress: SearchProgress) -> Design:
    """Return the best design of a campaign, as its table ``[design]`` asks for it.

    Raises
    ------
    InputError
        If the campaign has nothing to free, its wishes do not fit it, or nothing is as good as asked.
    """
    result = _design_tones(plan, fit_model, progress)
    if not result.problem.angles:
        return result
    campaign, angles = inertial_design.shorten_noise_runs(
        result.campaign, result.problem.angles, fit_model.inertial_model(result.campaign)
    )
    return replace(result, campaign=campaign, angles=angles)


def _design_tones(plan: Campaign, fit_model: FitModel, progress: SearchProgress) -> Design:
    spec = plan.design
    problem = design_problem(plan, fit_model)
    progress.on_share(PROBLEM_SHARE)
    progress = progress.subrange(PROBLEM_SHARE, 1.0)
    if spec.authority:
        problem = authority_selection.select_authority(problem, fit_model, progress)
        progress.on_share(AUTHORITY_SHARE)
        progress = progress.subrange(AUTHORITY_SHARE, 1.0)
    if spec.goal == "least hours":
        return _minimize_duration(problem, fit_model, progress)
    if spec.hours is None:
        return search(problem, fit_model, progress)
    optimum = duration_allocation.optimize_durations(problem, spec.hours, progress)
    result = search(duration_allocation.apply_durations(problem, optimum, fit_model), fit_model, progress)
    return replace(result, optimum=replace(result.optimum, bound=optimum.bound))


def _minimize_duration(problem: DesignProblem, fit_model: FitModel, progress: SearchProgress) -> Design:
    """Return the design that makes all sigmas as small as wanted in the least hours that are found.

    Experiments that need not be are left out, one after the other, as long as hours become fewer by it.
    """
    initial = problem.plan.design.hours or max(
        sum(experiment.model.duration for experiment in problem.experiments), _min_duration(problem)
    )
    result, share = (
        _search_durations(problem, initial, fit_model, progress.subrange(0.0, 1 - SEARCH_SHARE)),
        SEARCH_SHARE,
    )
    while result.complete:
        try:
            reduced = duration_allocation.drop_experiment(problem, result, fit_model)
            if reduced is None:
                break
            shorter = _search_durations(
                reduced,
                _min_duration(reduced),
                fit_model,
                progress.subrange(1 - share, 1 - share * SEARCH_SHARE),
            )
        except (InputError, RunError):
            break  # all that are left are needed
        except KeyboardInterrupt:
            return replace(result, complete=False)
        result, problem = (
            (shorter, reduced) if shorter.value <= 1 else (replace(result, complete=False), problem)
        )
        share *= SEARCH_SHARE
    if not result.complete:
        return result
    return replace(
        result, min_duration=_duration_lower_bound(problem, _min_duration(problem), result.duration)
    )


def _min_duration(problem: DesignProblem) -> float:
    return float(duration_allocation.min_durations(problem).sum())


def _search_durations(
    problem: DesignProblem, total: float, fit_model: FitModel, progress: SearchProgress
) -> Design:
    """Return the best of a few searches, each in the hours that the one before leads to expect.

    The first is in `total` [s].
    """
    minimum, maximum = _min_duration(problem), problem.plan.design.hours
    shortest: Design | None = None
    for n in range(MAX_SEARCHES):
        try:
            total, power = _feasible_duration(problem, total, progress)
            problem_in_time = duration_allocation.apply_durations(problem, power, fit_model)
            result = search(
                problem_in_time,
                fit_model,
                progress.subrange(1 - SEARCH_SHARE**n, 1 - SEARCH_SHARE ** (n + 1)),
            )
        except KeyboardInterrupt:
            if shortest is None:
                raise
            return replace(shortest, complete=False)
        progress.on_value(f"worst ratio in {result.duration / HOUR:.2f} h", result.value)
        if not result.complete:
            return replace(shortest, complete=False) if shortest else result
        if result.value <= 1 and (shortest is None or result.duration < shortest.duration):
            shortest = result
        finished = result.value <= 1 and (result.value > MIN_WORST_RATIO or total <= minimum)
        if finished or (result.value > 1 and total == maximum):
            break
        total = max(minimum, total * result.value**2 * DURATION_MARGIN)
        total = min(total, maximum) if maximum else total
    if shortest is None:
        worst = max(result.problem.parameters, key=lambda name: result.ratios.get(name, float("inf")))
        raise InputError(
            f"design.hours: in {result.duration / HOUR:.3g} h some sigma remains {result.value:.3g} times "
            f"what is wanted; {worst} is among those that limit"
        )
    return shortest


def _feasible_duration(
    problem: DesignProblem, total: float, progress: SearchProgress
) -> tuple[float, Optimum]:
    """Return a duration [s] from `total` on in which the bound allows the target sigmas, and the best power.

    Raises
    ------
    InputError
        If there are none.
    """
    maximum = problem.plan.design.hours or max(MAX_DURATION, total)
    power = duration_allocation.optimize_durations(problem, total, progress)
    while power.bound > 1:
        if total >= maximum:
            worst = problem.parameters[int(np.argmax(problem.objective.logs(power.information)))]
            raise InputError(
                f"design.hours: in {total / HOUR:.4g} h no design does, some sigma remains "
                f"{power.bound:.3g} times the goal; {worst} is among those that limit"
            )
        total = min(total * power.bound**2, maximum)
        power = duration_allocation.optimize_durations(problem, total, progress)
    return total, power


def _duration_lower_bound(problem: DesignProblem, minimum: float, maximum: float) -> float:
    """Return a duration [s] in which no design reaches the target sigmas, or the shortest possible one."""
    low, high = minimum, maximum
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if duration_allocation.duration_bound(problem, middle) > 1 else (low, middle)
        )
    return low
