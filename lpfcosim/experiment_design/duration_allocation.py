"""Durations as part of a design: a total shared among experiments, or the least that suffices."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, RunError
from lpfcosim.experiment_design import convex_bound
from lpfcosim.experiment_design.convex_bound import Optimum
from lpfcosim.experiment_design.cvxpy_problem import TimeBudget
from lpfcosim.experiment_design.design_problem import DesignProblem, build_problem
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.schedule import HOUR, TIME_STEP, check_schedule
from lpfcosim.experiment_design.search import SETTLING_TIME, Design, SearchProgress
from lpfcosim.spacecraft import FS, Sine

Array = NDArray[np.float64]


def optimize_durations(problem: DesignProblem, total: float, progress: SearchProgress) -> Optimum:
    """Return the best power with hours shared out at best.

    Raises
    ------
    InputError
        If they are too few.
    """
    minimum = min_durations(problem)
    if total < minimum.sum():
        raise InputError(
            f"design.hours: {total / HOUR:g} h are too few, the experiments last "
            f"{minimum.sum() / HOUR:g} h at the least"
        )
    forbidden = problem.plan.design.forbidden
    hours = TimeBudget(total, minimum)
    return convex_bound.optimize_power(
        problem.experiments,
        problem.prior_information,
        problem.objective,
        forbidden,
        progress.on_bound,
        budget=hours,
    )


def apply_durations(problem: DesignProblem, optimum: Optimum, fit_model: FitModel) -> DesignProblem:
    """Return the same with its hours as the best power has them.

    Raises
    ------
    InputError
        If an experiment would reach into the next.
    """
    durations = np.maximum(np.floor(optimum.durations / TIME_STEP) * TIME_STEP, min_durations(problem))
    names = [experiment.run.experiment for experiment in problem.experiments]
    plan = with_durations(problem.plan, dict(zip(names, durations.tolist(), strict=True)))
    return build_problem(plan, problem.sigmas_before, problem.baseline_limits, fit_model)


def drop_experiment(problem: DesignProblem, design: Design, fit_model: FitModel) -> DesignProblem | None:
    """Return the same without the experiment that is missed least, to take less time than what was found.

    Only those are tried that last no longer than they must, and whose noise determines no inertial period.

    Returns
    -------
    Problem or None
        None if what is wanted is out of reach without any of them.
    """
    durations = {
        experiment.run.experiment: experiment.model.duration for experiment in design.problem.experiments
    }
    max_duration, lowest, reduced = design.duration - TIME_STEP, 1.0, None
    for experiment, minimum in zip(problem.experiments, min_durations(problem), strict=True):
        name = experiment.run.experiment
        if durations[name] > minimum or any(
            e.name == name and e.inertial_period for e in problem.plan.experiments
        ):
            continue
        rest = _without_experiment(problem, name, max_duration, fit_model)
        if rest is None or min_durations(rest).sum() > max_duration:
            continue
        with suppress(RunError, np.linalg.LinAlgError):  # of information that does not determine all
            bound = duration_bound(rest, max_duration)
            if bound <= lowest:
                lowest, reduced = bound, rest
    return reduced


def _without_experiment(
    problem: DesignProblem, name: str, max_duration: float, fit_model: FitModel
) -> DesignProblem | None:
    """Return the same without an experiment, in so many hours [s] at most; None if parameters go with it."""
    rest = tuple(e for e in problem.plan.experiments if e.name != name)
    if not any(e.n_samples for e in rest):
        return None
    spec = replace(problem.plan.design, hours=max_duration)
    reduced = build_problem(
        replace(problem.plan, experiments=rest, design=spec),
        problem.sigmas_before,
        problem.baseline_limits,
        fit_model,
    )
    return reduced if reduced.parameters == problem.parameters else None


def duration_bound(problem: DesignProblem, max_duration: float) -> float:
    """Return what no design that lasts so long [s] in all goes below, by a single round of the programme."""
    return convex_bound.optimize_power(
        problem.experiments,
        problem.prior_information,
        problem.objective,
        problem.plan.design.forbidden,
        rounds=1,
        budget=TimeBudget(max_duration, min_durations(problem)),
    ).bound


def min_durations(problem: DesignProblem) -> Array:
    """Return the shortest duration of each experiment [s]; its other injections stay as they are."""
    ends = [
        max(
            (i.end + SETTLING_TIME for i in experiment.run.injections if not isinstance(i, Sine)), default=0.0
        )
        for experiment in problem.experiments
    ]
    return np.maximum(np.ceil(np.array(ends) / TIME_STEP) * TIME_STEP, problem.plan.design.shortest)


def with_durations(plan: Campaign, durations: Mapping[str, float]) -> Campaign:
    """Return a campaign whose experiments with these names last as long [s].

    Raises
    ------
    InputError
        If one would reach into the next.
    """
    experiments = tuple(
        replace(e, n_samples=round(durations[e.name] * FS)) if e.name in durations else e
        for e in plan.experiments
    )
    return check_schedule(replace(plan, experiments=experiments))
