"""A design from a campaign: settings first, then hours, then tones."""

from dataclasses import replace

import numpy as np

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, RunError
from lpfcosim.experiment_design import calibration, hours, settings
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.programme import Optimum
from lpfcosim.experiment_design.search import Design, Told, search
from lpfcosim.experiment_design.sought import Problem, problem
from lpfcosim.experiment_design.timetable import HOUR

LAST = 0.99  # worst ratio from which on fewer hours are not worth another search
SEARCHES = 5  # for the least hours, at most
LONGEST = 7.2e6  # s, the most that is tried where nothing is said
SPARE = 1.002  # of the hours that one search leads the next to expect
BISECTIONS = 8
BEGUN, SETTLED = 0.05, 0.3  # shares of the time after which experiments and settings are there
HALF = 0.5  # of what is left goes to one search, where it may be the last


def design(plan: Campaign, fit_model: FitModel, told: Told) -> Design:
    """Return the best design of a campaign, as its table ``[design]`` asks for it.

    Raises
    ------
    InputError
        If the campaign has nothing to free, its wishes do not fit it, or nothing is as good as asked.
    """
    found = _of_tones(plan, fit_model, told)
    if not found.problem.angles:
        return found
    campaign, angles = calibration.settled(
        found.campaign, found.problem.angles, fit_model.inertial_model(found.campaign)
    )
    return replace(found, campaign=campaign, angles=angles)


def _of_tones(plan: Campaign, fit_model: FitModel, told: Told) -> Design:
    wishes = plan.design
    sought = problem(plan, fit_model)
    told.done(BEGUN)
    told = told.part(BEGUN, 1.0)
    if wishes.authority:
        sought = settings.settled(sought, fit_model, told)
        told.done(SETTLED)
        told = told.part(SETTLED, 1.0)
    if wishes.goal == "least hours":
        return _soonest(sought, fit_model, told)
    if wishes.hours is None:
        return search(sought, fit_model, told)
    best = hours.solved(sought, wishes.hours, told)
    found = search(hours.shared(sought, best, fit_model), fit_model, told)
    return replace(found, optimum=replace(found.optimum, bound=best.bound))


def _soonest(sought: Problem, fit_model: FitModel, told: Told) -> Design:
    """Return the design that makes all sigmas as small as wanted in the least hours that are found.

    Experiments that need not be are left out, one after the other, as long as hours become fewer by it.
    """
    begin = sought.plan.design.hours or max(
        sum(stage.sight.duration for stage in sought.stages), _least(sought)
    )
    best, left = _in_few_hours(sought, begin, fit_model, told.part(0.0, 1 - HALF)), HALF
    while best.complete:
        try:
            fewer = hours.without_one(sought, best, fit_model)
            if fewer is None:
                break
            found = _in_few_hours(fewer, _least(fewer), fit_model, told.part(1 - left, 1 - left * HALF))
        except (InputError, RunError):
            break  # all that are left are needed
        except KeyboardInterrupt:
            return replace(best, complete=False)
        best, sought = (found, fewer) if found.value <= 1 else (replace(best, complete=False), sought)
        left *= HALF
    if not best.complete:
        return best
    return replace(best, fewest=_fewest(sought, _least(sought), best.hours))


def _least(sought: Problem) -> float:
    return float(hours.shortest(sought).sum())


def _in_few_hours(sought: Problem, total: float, fit_model: FitModel, told: Told) -> Design:
    """Return the best of a few searches, each in the hours that the one before leads to expect.

    The first is in `total` [s].
    """
    least, most = _least(sought), sought.plan.design.hours
    best: Design | None = None
    for n in range(SEARCHES):
        try:
            total, power = _enough(sought, total, told)
            shared = hours.shared(sought, power, fit_model)
            found = search(shared, fit_model, told.part(1 - HALF**n, 1 - HALF ** (n + 1)))
        except KeyboardInterrupt:
            if best is None:
                raise
            return replace(best, complete=False)
        told.value(f"worst ratio in {found.hours / HOUR:.2f} h", found.value)
        if not found.complete:
            return replace(best, complete=False) if best else found
        if found.value <= 1 and (best is None or found.hours < best.hours):
            best = found
        done = found.value <= 1 and (found.value > LAST or total <= least)
        if done or (found.value > 1 and total == most):
            break
        total = max(least, total * found.value**2 * SPARE)
        total = min(total, most) if most else total
    if best is None:
        worst = max(found.problem.wanted, key=lambda name: found.ratios.get(name, float("inf")))
        raise InputError(
            f"design.hours: in {found.hours / HOUR:.3g} h some sigma stays at {found.value:.3g} times what "
            f"is wanted; {worst} is among those that hinder"
        )
    return best


def _enough(sought: Problem, total: float, told: Told) -> tuple[float, Optimum]:
    """Return hours [s], so many or more, in which a bound does not forbid what is wanted; and the best power.

    Raises
    ------
    InputError
        If there are none.
    """
    most = sought.plan.design.hours or max(LONGEST, total)
    power = hours.solved(sought, total, told)
    while power.bound > 1:
        if total >= most:
            worst = sought.wanted[int(np.argmax(sought.objective.logs(power.information)))]
            raise InputError(
                f"design.hours: in {total / HOUR:.4g} h no design does, some sigma stays at "
                f"{power.bound:.3g} times what is wanted; {worst} is among those that hinder"
            )
        total = min(total * power.bound**2, most)
        power = hours.solved(sought, total, told)
    return total, power


def _fewest(sought: Problem, least: float, enough: float) -> float:
    """Return a time [s] in which no design reaches what is wanted, or the shortest there is."""
    low, high = least, enough
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if hours.least_value(sought, middle) > 1 else (low, middle)
    return low
