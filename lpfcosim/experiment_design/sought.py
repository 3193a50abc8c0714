"""What is sought: the experiments of a campaign with their limits, and what they are to tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.files import closest_match
from lpfcosim.campaign import Campaign, DesignSpec
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import limits
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.limits import Limit
from lpfcosim.experiment_design.objective import Objective
from lpfcosim.experiment_design.stage import Stage
from lpfcosim.spacecraft import Injection, Run, Sine

Array = NDArray[np.float64]

FAINT = 1e-6  # of tones, so that they tell nothing
ENOUGH = 600  # frequencies, among which one must be allowed
HELD: Mapping[str, tuple[tuple[str, str], ...]] = {
    "peaks and rms of thrust": (
        *((name, "peak") for name in limits.QUANTITIES if name != "F_x_sc"),
        ("F_x_sc", "rms"),
    ),
    "peaks": tuple((name, "peak") for name in limits.QUANTITIES),
    "rms": tuple((name, "rms") for name in limits.QUANTITIES),
}


@dataclass(frozen=True)
class Problem:
    """What is sought.

    Attributes
    ----------
    plan : Campaign
        The campaign as it is.
    names : tuple of str
        Of the P parameters.
    before : mapping of str to float
        Sigmas of the campaign as it is.
    stages : tuple of Stage
        The experiments.
    fixed : ndarray, shape (P, P)
        Information beside them, scaled.
    objective : Objective
        What counts.
    own : mapping of str to tuple of Limit
        What the tones of the campaign reached to begin with, by experiment.
    angles : mapping of str to float
        Sigmas that are wanted of the inertial calibration [rad].
    """

    plan: Campaign
    names: tuple[str, ...]
    before: Mapping[str, float]
    stages: tuple[Stage, ...]
    fixed: Array
    objective: Objective
    own: Mapping[str, tuple[Limit, ...]]
    angles: Mapping[str, float]

    @property
    def known(self) -> Array:
        """Information without any tone, scaled, shape (P, P)."""
        return np.asarray(self.fixed + sum(stage.known for stage in self.stages))

    @property
    def wanted(self) -> tuple[str, ...]:
        """The parameters that count."""
        return tuple(self.names[i] for i in self.objective.wanted)


def problem(plan: Campaign, fit_model: FitModel) -> Problem:
    """Return what is sought.

    Raises
    ------
    InputError
        If the campaign has nothing to free, or its wishes do not fit it.
    """
    wishes = plan.design
    before = fit_model.sigmas(plan)
    of_turns = set(wishes.sigmas) - set(before)
    told = {*before, *(fit_model.inertial_model(plan).sigmas(plan) if of_turns else ())}
    for key, table, known in (("weights", wishes.weights, before), ("sigmas", wishes.sigmas, told)):
        for name in table:
            if name not in known:
                raise InputError(f"design.{key}: the fit tells no {name}{closest_match(name, known)}")
    if not before:
        raise InputError("the fit of this campaign determines nothing, expected injections to begin with")
    own = {run.experiment: limits.own(run, HELD[wishes.held]) for run in plan.runs if run.kind == "sysid"}
    return changed(plan, before, own, fit_model)


def changed(
    plan: Campaign,
    before: Mapping[str, float],
    own: Mapping[str, tuple[Limit, ...]],
    fit_model: FitModel,
) -> Problem:
    """Return the same for other hours or settings than those that `before` and `own` come from.

    Raises
    ------
    InputError
        If the campaign has nothing to free, or its wishes do not fit it.
    """
    wishes = plan.design
    bare = with_tones(plan, {e.name: () for e in plan.experiments})
    told = fit_model.information(with_tones(plan, {e.name: _faint(e.injections) for e in plan.experiments}))
    names, widths = told.names, told.widths
    lost = np.array([name not in before for name in names]) & (np.diag(told.prior) == 0)
    scale = np.array(
        [wishes.sigmas.get(n, before.get(n, w)) for n, w in zip(names, widths, strict=True)], dtype=float
    )
    runs = {run.experiment: run for run in bare.runs if run.kind == "sysid"}
    stages = tuple(
        Stage(runs[sight.name], sight, _limits(runs[sight.name], own[sight.name], wishes), scale)
        for sight in told.experiments
    )
    free = tuple(stage for stage in stages if stage.loops)
    if not free:
        raise InputError(_nothing_free(stages, wishes))
    for stage in free:
        if not stage.frequencies(ENOUGH, wishes.forbidden).size:
            raise InputError(f"design.forbidden: experiment {stage.run.experiment} has no frequency left")
    fixed = np.diag(np.where(lost, (scale / widths) ** 2, 0.0)) + scale[:, None] * told.prior * scale
    fixed = fixed + sum((stage.known for stage in stages if not stage.loops), np.zeros_like(fixed))
    objective = _objective(wishes, [n for n in names if n in before], names)
    angles = {name: sigma for name, sigma in wishes.sigmas.items() if name not in before}
    return Problem(plan, names, before, free, fixed, objective, own, angles)


def _nothing_free(stages: Sequence[Stage], wishes: DesignSpec) -> str:
    """Say why no loop is free: limits on next to nothing, or nothing that drives one."""
    said = {f"{cap.kind} of {cap.quantity}" for cap in wishes.caps}
    closing = {limit.name for stage in stages for limit in stage.limits if limit.of_nothing} & said
    if closing:
        return f"design.limits: {' and '.join(sorted(closing))} so small leave no loop to drive"
    return "there is nothing to free: no loop of any experiment is driven by tones"


def _faint(injections: Sequence[Injection]) -> tuple[Sine, ...]:
    """Return tones that tell nothing: a channel that nothing moved at all would count as not recorded."""
    return tuple(replace(i, amplitude=i.amplitude * FAINT) for i in injections if isinstance(i, Sine))


def _objective(wishes: DesignSpec, wanted: Sequence[str], names: Sequence[str]) -> Objective:
    weights = np.array([wishes.weights.get(name, 1.0) for name in wanted])
    most = np.full(len(wanted), np.inf if wishes.no_worse is None else wishes.no_worse)
    index = np.array([names.index(name) for name in wanted], dtype=np.intp)
    return Objective(index, weights / weights.sum(), wishes.goal != "geometric mean", most)


def _limits(run: Run, own: Sequence[Limit], wishes: DesignSpec) -> tuple[Limit, ...]:
    """Return the limits of a run: its own, or those that the wishes have instead, and its authority."""
    capped = {cap.quantity for cap in wishes.caps}
    found = [limit for limit in own if limit.quantity not in capped]
    resting = limits.resting(run)
    authority = {"F_x_1": run.authority.F_max_1, "F_x_2": run.authority.F_max_2}
    for cap in wishes.caps:
        value = cap.value * authority[cap.quantity] if cap.of_authority else cap.value
        if cap.kind == "peak":
            value -= resting.get(cap.quantity, 0.0)
        if value <= 0 and not (cap.of_authority and cap.quantity == "F_x_1"):
            raise InputError(
                f"design.limits.{cap.quantity}.{cap.kind}: run {run.name} is beyond it without any tone"
            )
        found.append(Limit(cap.quantity, cap.kind, max(value, 0.0)))
    peaks = {limit.quantity for limit in found if limit.kind == "peak"}
    for quantity, most in authority.items():
        left = most - resting.get(quantity, 0.0)
        if most > 0 and left <= 0:
            raise InputError(f"{quantity} of run {run.name} is beyond its authority without any tone")
        if quantity not in peaks and most > 0:
            found.append(Limit(quantity, "authority", left))
    return tuple(found)


def with_tones(plan: Campaign, tones_of: Mapping[str, Sequence[Sine]]) -> Campaign:
    """Return a campaign with other tones in the experiments named."""
    experiments = tuple(
        replace(
            e,
            injections=(*(i for i in e.injections if not isinstance(i, Sine)), *tones_of[e.name]),
        )
        if e.name in tones_of
        else e
        for e in plan.experiments
    )
    return replace(plan, experiments=experiments)
