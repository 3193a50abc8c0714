"""Hours as part of a design: shared out among experiments, or as few as reach what is wanted."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, RunError
from lpfcosim.experiment_design import programme
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.programme import Optimum
from lpfcosim.experiment_design.search import AFTER, Design, Told
from lpfcosim.experiment_design.solving import Hours
from lpfcosim.experiment_design.sought import Problem, changed
from lpfcosim.experiment_design.timetable import HOUR, WHOLE, in_turn
from lpfcosim.spacecraft import FS, Sine

Array = NDArray[np.float64]


def solved(sought: Problem, total: float, told: Told) -> Optimum:
    """Return the best power with hours shared out at best.

    Raises
    ------
    InputError
        If they are too few.
    """
    least = shortest(sought)
    if total < least.sum():
        raise InputError(
            f"design.hours: {total / HOUR:g} h are too few, the experiments last "
            f"{least.sum() / HOUR:g} h at the least"
        )
    forbidden = sought.plan.design.forbidden
    hours = Hours(total, least)
    return programme.optimum(
        sought.stages, sought.fixed, sought.objective, forbidden, told.bound, hours=hours
    )


def shared(sought: Problem, best: Optimum, fit_model: FitModel) -> Problem:
    """Return the same with its hours as the best power has them.

    Raises
    ------
    InputError
        If an experiment would reach into the next.
    """
    lasting = np.maximum(np.floor(best.durations / WHOLE) * WHOLE, shortest(sought))
    names = [stage.run.experiment for stage in sought.stages]
    plan = with_durations(sought.plan, dict(zip(names, lasting.tolist(), strict=True)))
    return changed(plan, sought.before, sought.own, fit_model)


def without_one(sought: Problem, found: Design, fit_model: FitModel) -> Problem | None:
    """Return the same without the experiment that is missed least, to take less time than what was found.

    Only those are tried that last no longer than they must, and whose noise tells no inertial period.

    Returns
    -------
    Problem or None
        None if what is wanted is out of reach without any of them.
    """
    lasting = {stage.run.experiment: stage.sight.duration for stage in found.problem.stages}
    most, lowest, best = found.hours - WHOLE, 1.0, None
    for stage, least in zip(sought.stages, shortest(sought), strict=True):
        name = stage.run.experiment
        if lasting[name] > least or any(
            e.name == name and e.inertial_period for e in sought.plan.experiments
        ):
            continue
        rest = _without(sought, name, most, fit_model)
        if rest is None or shortest(rest).sum() > most:
            continue
        with suppress(RunError, np.linalg.LinAlgError):  # of information that does not tell all
            bound = least_value(rest, most)
            if bound <= lowest:
                lowest, best = bound, rest
    return best


def _without(sought: Problem, name: str, most: float, fit_model: FitModel) -> Problem | None:
    """Return the same without an experiment, in so many hours [s] at most; None if parameters go with it."""
    rest = tuple(e for e in sought.plan.experiments if e.name != name)
    if not any(e.n_samples for e in rest):
        return None
    wishes = replace(sought.plan.design, hours=most)
    less = changed(
        replace(sought.plan, experiments=rest, design=wishes), sought.before, sought.own, fit_model
    )
    return less if less.wanted == sought.wanted else None


def least_value(sought: Problem, most: float) -> float:
    """Return what no design that lasts so long [s] in all goes below, by a single round of the programme."""
    return programme.optimum(
        sought.stages,
        sought.fixed,
        sought.objective,
        sought.plan.design.forbidden,
        rounds=1,
        hours=Hours(most, shortest(sought)),
    ).bound


def shortest(sought: Problem) -> Array:
    """Return how long each experiment lasts at the least [s]: what is no tone of it stays as it is."""
    ends = [
        max((i.end + AFTER for i in stage.run.injections if not isinstance(i, Sine)), default=0.0)
        for stage in sought.stages
    ]
    return np.maximum(np.ceil(np.array(ends) / WHOLE) * WHOLE, sought.plan.design.shortest)


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
    return in_turn(replace(plan, experiments=experiments))
