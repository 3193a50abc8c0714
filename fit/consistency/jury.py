"""The joint fit of those runs that can be fitted together, and what is said of the others.

A run whose o_1 moves against its guidance, one that keeps the joint fit from settling, and one that
contradicts the others is left out by name. Only where nothing is left is everything refused.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fit.consistency.agreement import (
    ALONE,
    DELAY,
    GAIN,
    LEANS,
    Agreed,
    agree,
    alike,
    leaning,
    odd_ones,
    scattering,
)
from fit.consistency.consistency import Regression, regression, voice, voiced
from fit.consistency.explanation import Court, of_odd
from fit.consistency.lasting import in_common, own_lag
from fit.errors import FitError, InputError
from fit.fitting import IRLSResult, fit_joint
from fit.model import Sharing
from fit.parallel import parallel_map
from fit.quality import Exclusion, fit_quality, told
from fit.settings import Settings
from fit.warnings import FitWarning
from fit.whitening import Experiment, whitened_run

UNTOLD = ("flscov",)  # estimators whose sigmas are too small by far to judge by


def convene(
    experiments: Sequence[Experiment],
    alone: Mapping[str, IRLSResult | FitError],
    chosen: Settings,
    misfits: Mapping[str, str],
    drawn: bool,
    constant: bool,
) -> Agreed:
    """Fit those experiments jointly that can be.

    Parameters
    ----------
    experiments : sequence of Experiment
        That are to take part.
    alone : mapping of str to IRLSResult or FitError
        What each of them yields by itself.
    chosen : Settings
        Of the fit.
    misfits : mapping of str to str
        Experiments that do not follow the equation by themselves, and what is said of them.
    drawn : bool
        Whether for a Monte Carlo: o_1 is not late then, and nothing but what is drawn lasts in all runs.
    constant : bool
        Whether gains are known to be: which depart is asked once experiments disagree.

    Raises
    ------
    InputError
        If o_1 of every experiment moves against its guidance.
    FitError
        If no trustworthy estimate comes out.
    """
    left_out = _by_themselves(experiments, alone, misfits, drawn)
    first = _without_scatter(chosen) if constant and chosen.scatter == ["auto"] else chosen
    outcome, kept, failed = _settled(_without(experiments, left_out), alone, first)
    left_out = (*left_out, *failed)
    if chosen.estimator in UNTOLD:
        return Agreed(outcome, tuple(kept), left_out, (_unjudged(chosen),))
    return _agreed(outcome, kept, left_out, alone, chosen, drawn)


def _agreed(
    outcome: IRLSResult,
    kept: list[Experiment],
    left_out: tuple[Exclusion, ...],
    alone: Mapping[str, IRLSResult | FitError],
    chosen: Settings,
    drawn: bool,
) -> Agreed:
    """Leave out what contradicts the others until the rest agrees."""
    auto = chosen.scatter == ["auto"]
    while True:
        # a few that are wrong must not pass for gains that scatter; scatter without alarm is looked for too
        plain = _plainly(outcome, kept, chosen)
        voices = regression(kept, plain)
        if agree(voices, groups := _groups(kept)):
            if auto and plain is outcome and scattering(voices, ALONE):
                outcome = _scattered(kept, chosen) or plain
            voices = voices if plain is outcome else regression(kept, outcome)
            break
        blocks = _centred(kept, alone, plain)
        voices = voiced(kept, blocks, plain)
        odd = odd_ones(voices, groups)
        if odd is None:
            if auto and plain is outcome and scattering(voices):
                outcome = _scattered(kept, chosen) or plain
            voices = regression(kept, outcome)
            if not agree(voices, groups):
                return Agreed(outcome, tuple(kept), left_out, (_contradiction(voices, kept),), voices)
            break
        out = of_odd(voices, odd, Court(tuple(kept), blocks, plain, Sharing(chosen.shared)))
        left_out, kept = (*left_out, *out), _without(kept, out)
        outcome = fit_joint(kept, chosen, alone)
    return Agreed(outcome, tuple(kept), left_out, _told(voices, outcome, kept, drawn), voices)


def _unjudged(chosen: Settings) -> FitWarning:
    message = (
        f"the sigmas of {chosen.estimator} are too small to judge by: whether the experiments contradict "
        "each other was not looked at"
    )
    return FitWarning("consistency_untested", (), message)


def _plainly(outcome: IRLSResult, experiments: Sequence[Experiment], chosen: Settings) -> IRLSResult:
    """Return the fit without departures that the data chose; as it is if there are none."""
    if not outcome.by_data:
        return outcome
    return fit_joint(experiments, _without_scatter(chosen))


def _without_scatter(chosen: Settings) -> Settings:
    return chosen.model_copy(update={"scatter": []})


def _without(experiments: Sequence[Experiment], left_out: Iterable[Exclusion]) -> list[Experiment]:
    names = {f.experiment for f in left_out}
    return [e for e in experiments if e.name not in names]


def _by_themselves(
    experiments: Sequence[Experiment],
    alone: Mapping[str, IRLSResult | FitError],
    misfits: Mapping[str, str],
    drawn: bool,
) -> tuple[Exclusion, ...]:
    """Return the experiments that are left out for what each is by itself.

    Raises
    ------
    InputError
        If o_1 of every experiment moves against its guidance.
    """
    wrong = _wrong(experiments)
    odd = _misfits(_without(experiments, wrong), misfits)
    late = () if drawn else _late(_without(experiments, (*wrong, *odd)), alone)
    return (*wrong, *odd, *late)


def _wrong(experiments: Sequence[Experiment]) -> tuple[Exclusion, ...]:
    """Return the experiments whose o_1 moves against its guidance.

    Raises
    ------
    InputError
        If all of them do.
    """
    found: list[Exclusion] = []
    guided = parallel_map(fit_quality.wrong_guidance, [e.sysid.telemetry for e in experiments])
    for e, why in zip(experiments, guided, strict=True):
        if why:
            found.append(Exclusion(e.name, f"{e.sysid.telemetry.path}: {why}", tells="cause"))
    if found and len(found) == len(experiments):
        raise InputError(told(found))
    return tuple(found)


def _misfits(experiments: Sequence[Experiment], said: Mapping[str, str]) -> tuple[Exclusion, ...]:
    """Return the experiments that do not follow the equation, as `_fewer` does."""
    found = [Exclusion(e.name, said[e.name], own="", tells="misfit") for e in experiments if e.name in said]
    return _fewer(found, experiments)


def _late(
    experiments: Sequence[Experiment], alone: Mapping[str, IRLSResult | FitError]
) -> tuple[Exclusion, ...]:
    """Return the experiments whose o_1 is late by themselves, as `_fewer` does."""
    lags = parallel_map(lambda e: _lag(e, alone, len(experiments)), experiments)
    named = [(e, lag) for e, lag in zip(experiments, lags, strict=True) if lag]
    late = [Exclusion(e.name, f"{e.sysid.telemetry.path}: {lag}", tells="guess") for e, lag in named]
    return _fewer(late, experiments)


def _lag(e: Experiment, alone: Mapping[str, IRLSResult | FitError], among: int) -> str:
    own = alone[e.name]
    return own_lag(e, own, among) if isinstance(own, IRLSResult) else ""


def _fewer(found: Sequence[Exclusion], experiments: Sequence[Experiment]) -> tuple[Exclusion, ...]:
    """Return them if they are half of the experiments at most, and not all.

    What most have in common is a matter of the equation, or of how all were archived.
    """
    return tuple(found) if 2 * len(found) <= len(experiments) and len(found) < len(experiments) else ()


def _settled(
    experiments: list[Experiment], alone: Mapping[str, IRLSResult | FitError], chosen: Settings
) -> tuple[IRLSResult, list[Experiment], tuple[Exclusion, ...]]:
    """Fit jointly; if that does not settle or settles nothing, without those that do not fit by themselves.

    Raises
    ------
    FitError
        If it does not settle without them, or there are none.
    """
    try:
        outcome = fit_joint(experiments, chosen, alone)
    except FitError as error:
        why = fit_quality.suspects({e.name: alone[e.name] for e in experiments})
        why = why or _contradicting(experiments, alone, Sharing(chosen.shared))
        if not 0 < len(why) < len(experiments):
            suspects = f"; {' and '.join(why.values())}: mend or exclude it ([fit] exclude)" if why else ""
            raise FitError(f"{error}{suspects}") from error
        found = _misfitting(why, "nothing settles")
        kept = _without(experiments, found)
        return fit_joint(kept, chosen, alone), kept, found
    failed = {e.name: own for e in experiments if isinstance(own := alone[e.name], FitError)}
    if outcome.lost.any() and 0 < len(failed) < len(experiments):
        found = _misfitting(fit_quality.suspects(failed), "the data determine less than without")
        kept = _without(experiments, found)
        rest = fit_joint(kept, chosen, alone)
        if np.count_nonzero(rest.lost) < np.count_nonzero(outcome.lost):
            return rest, kept, found
    return outcome, experiments, ()


def _misfitting(why: Mapping[str, str], then: str) -> tuple[Exclusion, ...]:
    return tuple(
        Exclusion(name, f"{words}, and with it {then}", tells="misfit") for name, words in why.items()
    )


def _groups(experiments: Sequence[Experiment]) -> list[frozenset[str]]:
    """Return the runs of each authority and of each alignment epoch, by name."""
    found: dict[object, list[str]] = {}
    for e in experiments:
        run = e.sysid.telemetry
        for key in (run.authority, run.alignment_epoch):
            found.setdefault(key, []).append(e.name)
    return list(dict.fromkeys(map(frozenset, found.values())))


def _contradicting(
    experiments: Sequence[Experiment], alone: Mapping[str, IRLSResult | FitError], sharing: Sharing
) -> dict[str, str]:
    """Return words on the experiments that contradict the others, by name, where there is no joint fit."""
    parameters = sharing.parameters([(e.sysid.telemetry, e.parameters) for e in experiments])
    names = [p.name for p in parameters]
    theta, width = (np.array([getattr(p, of) for p in parameters]) for of in ("value", "prior_sigma"))
    voices = []
    for e in experiments:
        own = alone[e.name]
        if isinstance(own, IRLSResult):
            share = sharing.matrix(e.sysid.telemetry, e.parameters, names)
            voices.append(voice(e, replace(own.blocks[0], share=share), theta))
    odd = odd_ones(Regression(tuple(voices), width, np.zeros((0, theta.size)), np.zeros(0)))
    return {voices[i].name: f"{voices[i].name} contradicts the others" for i in odd.left_out} if odd else {}


def _scattered(experiments: Sequence[Experiment], chosen: Settings) -> IRLSResult | None:
    """Fit with gains and delays that scatter, if that makes the experiments agree."""
    names = [name for kind in (GAIN, DELAY) for name in kind.parameters]
    free = [name for name in names if chosen.shared.get(name) == "campaign"]
    try:
        outcome = fit_joint(experiments, chosen.model_copy(update={"scatter": free}))
    except FitError:
        return None
    agreed = agree(regression(experiments, outcome), _groups(experiments))
    return replace(outcome, by_data=True) if agreed else None


def _centred(
    experiments: Sequence[Experiment], alone: Mapping[str, IRLSResult | FitError], outcome: IRLSResult
) -> tuple[whitened_run.WhitenedRun, ...]:
    """Return the runs weighed about delays of their own: one that is far off has moved the common ones."""
    found = []
    for e, block in zip(experiments, outcome.blocks, strict=True):
        own = alone[e.name]
        if isinstance(own, FitError) or outcome.departing:  # which their own blocks have no columns for
            found.append(block)
        else:
            found.append(replace(own.blocks[0], share=block.share))
    return tuple(found)


def _contradiction(voices: Regression, experiments: Sequence[Experiment]) -> FitWarning:
    """Say that the experiments contradict each other, and as far as it can be told how."""
    whole = voices.whole
    message = (
        f"the experiments contradict each other: chi2 of what they say together is {whole.value:.4g} for "
        f"{whole.dof} degrees of freedom"
    )
    scattered = scattering(voices)
    if scattered:
        message += f"; {scattered[0].words} from experiment to experiment would explain it"
    else:
        # of runs that contradict alike, the first: the last digits are those of a machine
        worst = sorted(range(len(experiments)), key=lambda i: -float(f"{voices.of_run(i).value:.3g}"))
        names = " or ".join(experiments[i].name for i in worst[:2])
        if agree(voices):  # but for what some of them share
            shared = dict.fromkeys(s.members for s in alike(voices, _groups(experiments)))
            of_each = (" and ".join(experiments[i].name for i in members) for members in shared)
            names = " or ".join(f"{who} alike" for who in list(of_each)[:2])
        message += f"; which of them is wrong the data do not tell, {names} most likely"
    return FitWarning("contradiction", (), f"{message}; the sigmas do not hold")


def said(experiments: Sequence[Experiment], outcome: IRLSResult) -> list[FitWarning]:
    """Return what is to be said of a fit that leaves none of its experiments out."""
    if len(experiments) == 1:
        return []
    voices = regression(experiments, outcome)
    agreed = agree(voices, _groups(experiments))
    return _leaning(voices, outcome) if agreed else [_contradiction(voices, experiments)]


def _told(
    voices: Regression, outcome: IRLSResult, experiments: Sequence[Experiment], drawn: bool
) -> tuple[FitWarning, ...]:
    """Return what is to be said of runs that agree."""
    lasting = () if drawn else in_common(experiments, outcome)
    return (*_leaning(voices, outcome), *fit_quality.acausal(outcome), *lasting)


def _leaning(voices: Regression, outcome: IRLSResult) -> list[FitWarning]:
    """Say what rests on a single run."""
    found = []
    for i, grown in leaning(voices, outcome.lost).items():
        names = tuple(outcome.parameters[k].name for k in grown if k < outcome.shared)
        if names:
            run, verb = voices.voices[i].name, "rests" if len(names) == 1 else "rest"
            message = (
                f"{', '.join(names)} {verb} on {run}: sigma grows more than {LEANS:g} times without it, "
                "and no other run can show that it is wrong"
            )
            found.append(FitWarning("high_leverage", names, message))
    return found
