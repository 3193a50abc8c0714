"""The search: from a campaign and its wishes to other tones within the limits, with a bound beside them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fit.files import closest
from lpfcosim.campaign import Campaign, Wishes
from lpfcosim.design import limits, programme, tones, waveform
from lpfcosim.design.beginning import begun
from lpfcosim.design.limits import Limit
from lpfcosim.design.objective import Objective
from lpfcosim.design.programme import Optimum
from lpfcosim.design.stage import Sight, Stage
from lpfcosim.design.tones import Tone
from lpfcosim.design.waveform import Score, Span, Voice
from lpfcosim.errors import InputError
from lpfcosim.spacecraft import Run, Sine

Array = NDArray[np.float64]

HELD: Mapping[str, tuple[tuple[str, str], ...]] = {
    "peaks and rms of thrust": (
        *((name, "peak") for name in limits.QUANTITIES if name != "F_x_sc"),
        ("F_x_sc", "rms"),
    ),
    "peaks": tuple((name, "peak") for name in limits.QUANTITIES),
    "rms": tuple((name, "rms") for name in limits.QUANTITIES),
}
STARTS = 3  # drawn phases to begin with
TIGHTENED = 3  # times that limits are tightened by what transients add
AFTER = 600.0  # s that a run goes on after its tones: what follows them is checked as well
FLANK, RAMP = 0.05, 1080.0  # share of a run under a flank of the window; s, longest rise of a tone
SHORT_RAMP = 300.0  # s, where rms is what counts: tones clear of the flanks make the most of it


class Sights(Protocol):
    """What the experiments of a campaign tell, see `fit.estimate.sight.Sights`."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the P parameters."""

    @property
    def widths(self) -> Array:
        """Of their weak priors, shape (P,)."""

    @property
    def each(self) -> Sequence[Sight]:
        """The experiments."""


@dataclass(frozen=True)
class Foresight:
    """What a fit will know of a campaign.

    Attributes
    ----------
    sights : callable
        From a campaign to what its experiments tell, frequency by frequency.
    forecast : callable
        From a campaign to the sigmas of its joint fit, by parameter.
    """

    sights: Callable[[Campaign], Sights]
    forecast: Callable[[Campaign], Mapping[str, float]]


@dataclass(frozen=True)
class Told:
    """Who is told how the search goes on.

    Attributes
    ----------
    bound : callable
        Of value and bound of the programme.
    value : callable
        Of the objective that tones reach.
    """

    bound: Callable[[float, float], None]
    value: Callable[[float], None]


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
    """

    plan: Campaign
    names: tuple[str, ...]
    before: Mapping[str, float]
    stages: tuple[Stage, ...]
    fixed: Array
    objective: Objective

    @property
    def known(self) -> Array:
        """Information without any tone, scaled, shape (P, P)."""
        return np.asarray(self.fixed + sum(stage.known for stage in self.stages))

    @property
    def wanted(self) -> tuple[str, ...]:
        """The parameters that count."""
        return tuple(self.names[i] for i in self.objective.wanted)


@dataclass(frozen=True)
class Design:
    """What was found.

    Attributes
    ----------
    problem : Problem
        What was sought.
    optimum : Optimum
        The best power, and the bound.
    score : Score
        Tones that come near.
    tones : mapping of str to tuple of Tone
        By experiment.
    campaign : Campaign
        With these tones.
    after : mapping of str to float
        Sigmas to expect of it.
    reached : mapping of str to mapping of str to float
        By experiment and limit, what is reached in units of the limit, in the time domain.
    alone : mapping of str to float
        By parameter, the sigma that no design within the limits goes below.
    """

    problem: Problem
    optimum: Optimum
    score: Score
    tones: Mapping[str, tuple[Tone, ...]]
    campaign: Campaign
    after: Mapping[str, float]
    reached: Mapping[str, Mapping[str, float]]
    alone: Mapping[str, float]

    @property
    def value(self) -> float:
        """The objective by the forecast of the new campaign."""
        objective, scale = self.problem.objective, self.problem.stages[0].scale
        sigmas = np.array([self.after.get(name, np.inf) for name in self.problem.wanted])
        return objective.value(np.log(sigmas / scale[objective.wanted]))

    @property
    def efficiency(self) -> float:
        """The bound of the objective over what was reached."""
        return self.optimum.bound / self.value


def problem(plan: Campaign, foresight: Foresight) -> Problem:
    """Return what is sought.

    Raises
    ------
    InputError
        If the campaign has nothing to free, or its wishes do not fit it.
    """
    wishes = plan.design
    before = foresight.forecast(plan)
    bare = with_tones(plan, {e.name: () for e in plan.experiments})
    told = foresight.sights(bare)
    names = told.names
    for key, table in (("weights", wishes.weights), ("sigmas", wishes.sigmas)):
        for name in table:
            if name not in before:
                raise InputError(f"design.{key}: the fit tells no {name}{closest(name, before)}")
    if not before:
        raise InputError("the fit of this campaign determines nothing, expected injections to begin with")
    lost = np.array([name not in before for name in names])
    widths = told.widths
    scale = np.array(
        [wishes.sigmas.get(n, before.get(n, w)) for n, w in zip(names, widths, strict=True)], dtype=float
    )
    runs = {run.experiment: run for run in plan.runs if run.kind == "sysid"}
    bares = {run.experiment: run for run in bare.runs if run.kind == "sysid"}
    stages = tuple(
        Stage(bares[sight.name], sight, _limits(runs[sight.name], wishes), scale) for sight in told.each
    )
    if not any(stage.loops for stage in stages):
        raise InputError("there is nothing to free: no loop of any experiment is driven by tones")
    fixed = np.diag(np.where(lost, (scale / widths) ** 2, 0.0))
    fixed = fixed + sum((stage.known for stage in stages if not stage.loops), np.zeros_like(fixed))
    return Problem(
        plan,
        names,
        before,
        tuple(stage for stage in stages if stage.loops),
        fixed,
        _objective(wishes, [n for n in names if n in before], names),
    )


def _objective(wishes: Wishes, wanted: Sequence[str], names: Sequence[str]) -> Objective:
    weights = np.array([wishes.weights.get(name, 1.0) for name in wanted])
    most = np.full(len(wanted), np.inf if wishes.no_worse is None else wishes.no_worse)
    index = np.array([names.index(name) for name in wanted], dtype=np.intp)
    return Objective(index, weights / weights.sum(), wishes.goal == "worst ratio", most)


def _limits(run: Run, wishes: Wishes) -> tuple[Limit, ...]:
    """Return the limits of a run: its own, or those that the wishes have instead."""
    capped = {cap.quantity for cap in wishes.caps}
    held = [(name, kind) for name, kind in HELD[wishes.held] if name not in capped]
    found = list(limits.own(run, held))
    resting = limits.resting(run)
    for cap in wishes.caps:
        value = cap.value
        if cap.of_authority:
            value *= run.authority.F_max_1 if cap.quantity == "F_x_1" else run.authority.F_max_2
        if cap.kind == "peak":
            value -= resting.get(cap.quantity, 0.0)
        if value <= 0 and not (cap.of_authority and cap.quantity == "F_x_1"):
            raise InputError(
                f"design.limits.{cap.quantity}.{cap.kind}: run {run.name} is beyond it without any tone"
            )
        found.append(Limit(cap.quantity, cap.kind, max(value, 0.0)))
    return tuple(found)


def search(sought: Problem, foresight: Foresight, told: Told) -> Design:
    """Return the best tones that are found; interrupted, the best so far.

    Raises
    ------
    InputError
        If nothing is as good as asked, which is told with how near one comes.
    """
    wishes = sought.plan.design
    _check_reach(sought, wishes)
    best = programme.optimum(sought.stages, sought.fixed, sought.objective, wishes.forbidden, told.bound)
    score = _tones(sought, best, told)
    score = _fitted(sought, score, told)
    made = {
        voice.stage.run.experiment: tones.of(
            voice, score.information, sought.objective.wanted.tolist(), sought.names
        )
        for voice in score.voices
    }
    campaign = with_tones(
        sought.plan, {name: tuple(t.injection for t in found) for name, found in made.items()}
    )
    return Design(
        problem=sought,
        optimum=best,
        score=score,
        tones=made,
        campaign=campaign,
        after=foresight.forecast(campaign),
        reached=_reached(sought, campaign),
        alone=_alone(sought, wishes),
    )


def _check_reach(sought: Problem, wishes: Wishes) -> None:
    """Refuse what no design reaches, and tell how near one comes."""
    objective = sought.objective
    if not np.isfinite(objective.most).all():
        return
    plain = replace(objective, worst=True, most=np.full(objective.most.size, np.inf))
    nearest = programme.optimum(sought.stages, sought.fixed, plain, wishes.forbidden)
    if nearest.bound > float(objective.most.min()):
        logs = objective.logs(nearest.information)
        held_up = sought.wanted[int(np.argmax(logs))]
        raise InputError(
            f"design.no_worse: {objective.most.min():g} is beyond reach, within the limits some sigma stays "
            f"at {nearest.bound:.3g} times what is wanted; {held_up} is among those that hinder"
        )


def _alone(sought: Problem, wishes: Wishes) -> dict[str, float]:
    """Return, by parameter, a sigma that no design within the limits goes below, even for it alone."""
    found = {}
    for i, name in zip(sought.objective.wanted, sought.wanted, strict=True):
        one = Objective(np.array([i]), np.ones(1), worst=False, most=np.full(1, np.inf))
        least = programme.optimum(sought.stages, sought.fixed, one, wishes.forbidden, rounds=1)
        found[name] = least.bound * float(sought.stages[0].scale[i])
    return found


def _span(stage: Stage) -> Span:
    """Return when the tones of an experiment are on."""
    duration = stage.sight.duration
    flank = FLANK * duration
    if all(limit.kind == "rms" for limit in stage.bounds):
        start = round(max(flank - SHORT_RAMP, 0.0))
        return Span(start, duration - max(start, AFTER), min(SHORT_RAMP, flank))
    return Span(0.0, duration - AFTER, min(flank, RAMP))


def _tones(sought: Problem, best: Optimum, told: Told) -> Score:
    """Return few tones that reach the limits, the best of a few beginnings."""
    wishes, spans = sought.plan.design, [_span(stage) for stage in sought.stages]
    found: Score | None = None
    for seed in range(STARTS):
        generator = np.random.default_rng([sought.plan.seed, seed])
        try:
            voices = begun(sought.stages, spans, best, wishes.forbidden, wishes.spacing, seed, generator)
            score = waveform.composed(voices, sought.known, sought.objective, wishes.sines, told.value)
        except KeyboardInterrupt:
            if found is None:
                raise
            return found
        if found is None or score.value < found.value:
            found = score
    assert found is not None
    return found


def _fitted(sought: Problem, score: Score, told: Told) -> Score:
    """Return the tones once more, so that limits hold in the time domain, transients included."""
    for _ in range(TIGHTENED):
        over = [_over(voice) for voice in score.voices]
        tight = tuple(
            replace(voice, margins=voice.margins / np.where(found > 0.9, found, 1.0))
            for voice, found in zip(score.voices, over, strict=True)
        )
        score = waveform.finished(tight, sought.known, sought.objective, told.value)
    over = [_over(voice) for voice in score.voices]
    voices = tuple(
        replace(voice, amplitudes=voice.amplitudes / found.max())
        for voice, found in zip(score.voices, over, strict=True)
    )
    return waveform.scored(voices, sought.known, sought.objective)


def _over(voice: Voice) -> Array:
    """Return how far the tones of an experiment reach each of its limits in the time domain."""
    stage = voice.stage
    run = replace(stage.run, injections=tones.injections(voice))
    found = limits.excess(run, stage.bounds, limits.driven(run))
    return np.array([found[limit.name] for limit in stage.bounds])


def _reached(sought: Problem, campaign: Campaign) -> dict[str, dict[str, float]]:
    runs = {run.experiment: run for run in campaign.runs if run.kind == "sysid"}
    return {
        stage.run.experiment: limits.excess(
            runs[stage.run.experiment], stage.bounds, limits.driven(runs[stage.run.experiment])
        )
        for stage in sought.stages
    }


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
