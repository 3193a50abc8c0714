"""Hours as part of a design: shared out among experiments, or as few as reach what is wanted."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign
from lpfcosim.design import programme
from lpfcosim.design.programme import Optimum
from lpfcosim.design.search import AFTER, Told
from lpfcosim.design.solving import Hours
from lpfcosim.design.sought import Foresight, Problem, changed
from lpfcosim.design.timetable import HOUR, WHOLE, in_turn
from lpfcosim.errors import InputError
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


def shared(sought: Problem, best: Optimum, foresight: Foresight) -> Problem:
    """Return the same with its hours as the best power has them.

    Raises
    ------
    InputError
        If an experiment would reach into the next.
    """
    lasting = np.maximum(np.floor(best.durations / WHOLE) * WHOLE, shortest(sought))
    names = [stage.run.experiment for stage in sought.stages]
    plan = with_durations(sought.plan, dict(zip(names, lasting.tolist(), strict=True)))
    return changed(plan, sought.before, sought.own, foresight)


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
