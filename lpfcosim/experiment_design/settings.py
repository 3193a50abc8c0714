"""Settings of the actuation as part of a design: which authority each experiment had best.

The stiffness depends on them, so that they decide what an experiment tells of its parts. Of each experiment
one setting after the other is tried with the power that the convex programme has found, until none tells
more. Then the programme is solved anew.
"""

from dataclasses import fields, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import programme
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.programme import Optimum
from lpfcosim.experiment_design.search import Told
from lpfcosim.experiment_design.sought import Problem, changed
from lpfcosim.experiment_design.stage import Stage
from lpfcosim.spacecraft import Authority

Array = NDArray[np.float64]

ROUNDS = 4  # times that the programme is solved anew, at most
HARDLY = 1e13  # condition of information from which on settings leave some parameter untold
BETTER = 1e-3  # relative, by which the objective must fall for another one


def settled(sought: Problem, fit_model: FitModel, told: Told) -> Problem:
    """Return the same with the settings that tell most, among those that the wishes allow.

    Raises
    ------
    InputError
        If no setting is possible.
    """
    candidates = _candidates(sought, fit_model)
    if not candidates:
        raise InputError("design.authority: with none of these settings can the campaign be flown")
    best = _solved(sought, told)
    for _ in range(ROUNDS):
        settings = _exchanged(sought, best, [sought, *candidates])
        if not settings:
            break
        found = changed(_with(sought.plan, settings), sought.before, sought.own, fit_model)
        again = _solved(found, told)
        if again.value > best.value * (1 - BETTER):
            break
        sought, best = found, again
    return sought


def _solved(sought: Problem, told: Told) -> Optimum:
    forbidden = sought.plan.design.forbidden
    return programme.optimum(sought.stages, sought.fixed, sought.objective, forbidden, told.bound, rounds=1)


def _candidates(sought: Problem, fit_model: FitModel) -> list[Problem]:
    """Return the campaign with all experiments at the same of the allowed settings, one after the other."""
    allowed = sought.plan.design.authority
    found = []
    for values in product(*allowed.values()):
        said: dict[str, Any] = dict(zip(allowed, values, strict=True))
        settings = {e.name: replace(e.authority, **said) for e in sought.plan.experiments}
        try:
            found.append(changed(_with(sought.plan, settings), sought.before, sought.own, fit_model))
        except InputError:  # what is held without any tone is more than this allows, or the loop is unstable
            continue
    return found


def _exchanged(sought: Problem, best: Optimum, candidates: list[Problem]) -> dict[str, Authority]:
    """Return the settings that tell more than those of `sought`, by experiment; nothing if none does."""
    objective = sought.objective
    of_each = []
    for n, stage in enumerate(sought.stages):
        same = [
            other for c in candidates for other in c.stages if other.run.experiment == stage.run.experiment
        ]
        told = [_told(other, stage, best, n) for other in same]
        of_each.append(list(zip(same, told, strict=True)))
    now = [0] * len(of_each)

    def value(choice: list[int]) -> float:
        information = sought.fixed + sum(each[k][1] for each, k in zip(of_each, choice, strict=True))
        if np.linalg.cond(information) > HARDLY:
            return np.inf
        return objective.slope(objective.logs(information))[0]

    least, moved = value(now), True
    while moved:
        moved = False
        for n, each in enumerate(of_each):
            trials = [value([*now[:n], k, *now[n + 1 :]]) for k in range(len(each))]
            k = int(np.argmin(trials))
            if trials[k] < least - 1e-9:
                now[n], least, moved = k, trials[k], True
    if not any(now):
        return {}
    chosen = [each[k][0].run for each, k in zip(of_each, now, strict=True)]
    return {run.experiment: run.authority for run in chosen}


def _told(other: Stage, stage: Stage, best: Optimum, n: int) -> Array:
    """Return what an experiment tells at another setting with the same power, shrunk to its limits."""
    told, cost = other.responses(best.frequencies[n])
    power = np.zeros((len(told), len(other.loops), len(other.loops)), dtype=np.complex128)
    both = [loop for loop in stage.loops if loop in other.loops]
    to, of = ([loops.index(loop) for loop in both] for loops in (other.loops, stage.loops))
    power[:, np.array(to)[:, None], to] = best.powers[n][:, np.array(of)[:, None], of]
    spent = np.einsum("nyi,nij,nyj->y", cost, power, cost.conj()).real
    tones = np.einsum("npi,nij,nqj->pq", told, power, told.conj()).real * 2 * other.sight.duration
    return np.asarray(other.known + tones / max(float(spent.max()), 1.0))


def _with(plan: Campaign, settings: dict[str, Authority]) -> Campaign:
    """Return a campaign with other settings, those that are new named by their values."""
    experiments = tuple(
        replace(e, authority=_named(settings[e.name], plan)) if e.name in settings else e
        for e in plan.experiments
    )
    return replace(plan, experiments=experiments)


def _named(authority: Authority, plan: Campaign) -> Authority:
    numbers = [field.name for field in fields(Authority) if field.name != "name"]
    values = [getattr(authority, name) for name in numbers]
    for e in plan.experiments:
        if values == [getattr(e.authority, name) for name in numbers]:
            return e.authority
    said = (f"{value * 1e12:.4g}".replace(".", "p") for value in values)
    return replace(authority, name="F{}-{}-N{}-{}".format(*said))
