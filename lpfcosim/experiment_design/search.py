"""The search: from what is sought to few tones within the limits, with a bound beside them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lpfcosim.campaign import Campaign, DesignSpec
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import limits, programme, tones, waveform
from lpfcosim.experiment_design.beginning import begun, joined
from lpfcosim.experiment_design.calibration import Angles
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.programme import Optimum
from lpfcosim.experiment_design.sought import Problem, with_tones
from lpfcosim.experiment_design.stage import Stage
from lpfcosim.experiment_design.tones import Tone
from lpfcosim.experiment_design.waveform import Score, Span, Voice

Array = NDArray[np.float64]

TRIALS = 3  # beginnings, of which the best is kept
TIGHTENED = 3  # times that limits are tightened by what transients add
AFTER = 600.0  # s that a run goes on after its tones: what follows them is checked as well
FLANK, RAMP = 0.05, 1080.0  # share of a run under a flank of the window; s, longest rise of a tone
GROWN = 4  # times that other tones are tried beside those there are
SOLVED, COMPOSED, REGROWN, FINISHED = 0.05, 0.4, 0.6, 0.8  # shares of the time, done after what they name
SHORT_RAMP = 300.0  # s, where rms is what counts: tones clear of the flanks make the most of it


@dataclass(frozen=True)
class Told:
    """Who is told how the search goes on.

    Attributes
    ----------
    bound : callable
        Of value and bound of the programme.
    value : callable
        Of a step of the search, and of the objective that its tones reach.
    done : callable
        Of the share of the work that is done, from 0 to 1.
    """

    bound: Callable[[float, float], None]
    value: Callable[[str, float], None]
    done: Callable[[float], None]

    def part(self, begin: float, end: float) -> "Told":
        """Return the same for a part of the work, from one share of it to another."""
        return replace(self, done=lambda share: self.done(begin + share * (end - begin)))


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
    complete : bool
        False if the search was interrupted; `alone` is then left out.
    fewest : float, optional
        Hours that were sought: what no design of the same experiments does with less than [s].
    angles : Angles, optional
        What becomes of the inertial calibration, where its angles are sought.
    """

    problem: Problem
    optimum: Optimum
    score: Score
    tones: Mapping[str, tuple[Tone, ...]]
    campaign: Campaign
    after: Mapping[str, float]
    reached: Mapping[str, Mapping[str, float]]
    alone: Mapping[str, float]
    complete: bool
    fewest: float | None = None
    angles: Angles | None = None

    @property
    def ratios(self) -> dict[str, float]:
        """Sigmas to expect over those wanted, of the parameters that count and are determined."""
        problem = self.problem
        scale = problem.stages[0].scale[problem.objective.wanted].tolist()
        return {n: self.after[n] / s for n, s in zip(problem.wanted, scale, strict=True) if n in self.after}

    @property
    def hours(self) -> float:
        """Time that the experiments with tones take [s]."""
        return sum(stage.sight.duration for stage in self.problem.stages)

    @property
    def value(self) -> float:
        """The objective by the forecast of the new campaign."""
        ratios = [self.ratios.get(name, np.inf) for name in self.problem.wanted]
        return self.problem.objective.value(np.log(ratios))

    @property
    def efficiency(self) -> float:
        """The bound of the objective over what was reached."""
        return self.optimum.bound / self.value


def search(sought: Problem, fit_model: FitModel, told: Told) -> Design:
    """Return the best tones that are found; interrupted, the best so far.

    Raises
    ------
    InputError
        If nothing is as good as asked, which is told with how near one comes.
    KeyboardInterrupt
        If it comes before any tones are found.
    """
    wishes = sought.plan.design
    _check_reach(sought, wishes)
    best = programme.optimum(sought.stages, sought.fixed, sought.objective, wishes.forbidden, told.bound)
    told.done(SOLVED)
    score, complete = None, True
    try:
        for score in _better(sought, best, told.part(SOLVED, FINISHED)):  # noqa: B007 - the last one is wanted
            pass
    except KeyboardInterrupt:
        complete = False
        if score is None:
            raise
    assert score is not None
    shrunk = _shrunk(sought, score)
    return _design(sought, fit_model, best, shrunk, told.part(FINISHED, 1.0), complete=complete)


def _design(
    sought: Problem, fit_model: FitModel, best: Optimum, score: Score, told: Told, *, complete: bool
) -> Design:
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
        after=fit_model.sigmas(campaign),
        reached=_reached(sought, campaign),
        alone=_alone(sought, best, told) if complete else {},
        complete=complete,
    )


def _check_reach(sought: Problem, wishes: DesignSpec) -> None:
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


def _alone(sought: Problem, best: Optimum, told: Told) -> dict[str, float]:
    """Return, by parameter, a sigma that no design within the limits goes below, even for it alone."""
    objective, found = sought.objective, {}
    least = programme.alone(sought.stages, sought.fixed, objective, best, sought.plan.design.forbidden)
    for i, name, each in zip(objective.wanted, sought.wanted, least, strict=True):
        found[name] = each * float(sought.stages[0].scale[i])
        told.done(len(found) / len(sought.wanted))
    return found


def _span(stage: Stage) -> Span:
    """Return when the tones of an experiment are on."""
    duration = stage.sight.duration
    flank = FLANK * duration
    if not any(limit.of_wave for limit in stage.bounds):
        start = round(max(flank - SHORT_RAMP, 0.0))
        return Span(start, duration - max(start, AFTER), min(SHORT_RAMP, flank))
    return Span(0.0, duration - AFTER, min(flank, RAMP))


class _Steps:
    """Tell the value after each of so many steps."""

    def __init__(self, told: Told, name: str, number: int) -> None:
        self._told, self._name, self._number, self._made = told, name, number, 0

    def __call__(self, value: float) -> None:
        self._made += 1
        self._told.value(self._name, value)
        self._told.done(self._made / self._number)


def _better(sought: Problem, best: Optimum, told: Told) -> Iterator[Score]:
    """Yield few tones that reach the limits, the best so far of a few beginnings, then tightened ones."""
    found: Score | None = None
    whole = FINISHED - SOLVED
    grown = GROWN if any(limit.of_wave for stage in sought.stages for limit in stage.bounds) else 0
    composed = COMPOSED if grown else REGROWN
    shares = [0.0, (composed - SOLVED) / whole, (REGROWN - SOLVED) / whole, 1.0]
    drawing, growing, tightening = (told.part(*each) for each in pairwise(shares))
    for trial in range(TRIALS):
        score = _trial(sought, best, trial, drawing.part(trial / TRIALS, (trial + 1) / TRIALS))
        if found is None or score.value < found.value:
            found = score
        yield found
    assert found is not None
    for n in range(grown):
        score = _again(sought, found, n, growing.part(n / grown, (n + 1) / grown))
        if score.value < found.value:
            found = score
        yield found
    for n in range(TIGHTENED):
        over = [_over(voice) for voice in found.voices]
        tight = tuple(
            replace(voice, margins=voice.margins / np.where(reached > 0.9, reached, 1.0))
            for voice, reached in zip(found.voices, over, strict=True)
        )
        part = tightening.part(n / TIGHTENED, (n + 1) / TIGHTENED)
        step = _Steps(part, f"in the time domain, {n + 1} of {TIGHTENED}", 1)
        found = waveform.finished(tight, sought.known, sought.objective, step)
        yield found


def _trial(sought: Problem, best: Optimum, trial: int, told: Told) -> Score:
    """Return few tones from a beginning of their own."""
    wishes, spans = sought.plan.design, [_span(stage) for stage in sought.stages]
    generator = np.random.default_rng([sought.plan.seed, trial])
    step = _Steps(told, f"trial {trial + 1} of {TRIALS}", waveform.steps(wishes.sines))
    voices = begun(sought.stages, spans, best, wishes.forbidden, wishes.spacing, trial, generator)
    return waveform.composed(voices, sought.known, sought.objective, wishes.sines, step)


def _again(sought: Problem, found: Score, n: int, told: Told) -> Score:
    """Return few tones from those there are and all others beside them."""
    wishes = sought.plan.design
    generator = np.random.default_rng([sought.plan.seed, TRIALS, n])
    step = _Steps(told, f"other tones, {n + 1} of {GROWN}", 3)
    voices = [joined(voice, wishes.forbidden, generator) for voice in found.voices]
    return waveform.regrown(voices, sought.known, sought.objective, wishes.sines, step)


def _shrunk(sought: Problem, score: Score) -> Score:
    """Return the same tones, as large as limits in the time domain allow."""
    voices = tuple(replace(voice, amplitudes=voice.amplitudes / _over(voice).max()) for voice in score.voices)
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
