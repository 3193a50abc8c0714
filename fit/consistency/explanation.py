"""Why experiments are left out: the likeliest cause in words, none where none is clearly better.

What contradicts the others is asked of the parameters (`causes`), at the price of milliseconds. What does not
follow the equation, or follows it otherwise than all others, is asked of its samples (`hypotheses`, `parts`).
Each hypothesis mends the run, and what is left beside what the others say tells how likely it is. One is
named if it leaves nothing but noise and no other comes near; those that the data cannot tell from it are
named too.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from fit.consistency.causes import ALIKE, TOLD, Case, exchanged, named
from fit.consistency.consistency_test import ConsistencyTest, consistency_test
from fit.consistency.hypotheses import Hypothesis, of_all
from fit.consistency.parts import parts
from fit.consistency.trial import Trial
from fit.errors import FitError
from fit.fitting import IRLSResult
from fit.model import Sharing, dynamics
from fit.parallel import parallel_map
from fit.parameters import experiment_parameters
from fit.quality import Evidence, Exclusion, command_jumps, noise_adaptation
from fit.warnings import Cause
from fit.whitening import Experiment, whitened_run

ALARM = 1e-4  # p-value below which a run contradicts the others
PLAIN = ("sign", "unit", "scale", "lag", "exchange", "jump")  # kinds that others contain
OF_GAIN = ("sign", "unit", "scale")  # kinds of hypotheses that a gain alone suggests


class _Agreement(Protocol):
    """The joint fit of the runs that agree."""

    @property
    def outcome(self) -> IRLSResult: ...

    @property
    def experiments(self) -> tuple[Experiment, ...]: ...


def likeliest(trial: Trial, others: Sequence[Experiment], most: float = np.inf) -> list[Hypothesis]:
    """Return the hypothesis that explains a run, and those that the data cannot tell from it.

    Parameters
    ----------
    trial : Trial
        The run beside what the others say.
    others : sequence of Experiment
        Which may have lent it their channels.
    most : float
        chi2 that something else leaves already; what explains the run must leave clearly less.
    """
    plain = trial.as_it_is.left
    if plain.fits:
        return []
    found = [(trial.with_remedy(h.remedy), h) for h in of_all(trial, others)]
    best = min((left.chi2 + h.costs for left, h in found if left.fits), default=plain.chi2)
    least = plain.chi2 - best - ALIKE if best < plain.chi2 else ALIKE
    found += [(trial.with_remedy(h.remedy), h) for h in parts(trial, least)]
    scale = max(1.0, min((left.level for left, _ in found), default=1.0))
    lowest = min((left.chi2 + h.costs for left, h in found), default=np.inf)
    alike = [
        (left.chi2 + h.costs, h, left.fits)
        for left, h in found
        if left.chi2 + h.costs < lowest + ALIKE * scale
    ]
    if not alike or not all(fits for *_, fits in alike) or lowest > most - ALIKE * scale:
        return []
    return _simplest([h for _, h, _ in sorted(alike, key=lambda one: one[0])])


def _simplest(alike: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return those of which no simpler or likelier one says the same of the same channel, as they come."""
    plain = {h.cause.channel for h in alike if h.cause.kind in PLAIN}
    simple = [h for h in alike if h.cause.kind in PLAIN or h.cause.channel not in plain]
    return list({(h.cause.kind, h.cause.channel): h for h in reversed(simple)}.values())[::-1]


def explained(
    left_out: Iterable[Exclusion],
    experiments: Sequence[Experiment],
    alone: Mapping[str, IRLSResult | FitError],
    agreed: _Agreement,
    sharing: Sharing,
) -> tuple[Exclusion, ...]:
    """Return what was left out for its own sake with what would make it say what the others say.

    Parameters
    ----------
    left_out : iterable of Exclusion
        Experiments and reasons.
    experiments : sequence of Experiment
        All that could be prepared.
    alone : mapping of str to IRLSResult or FitError
        What each of them yields by itself.
    agreed : ConsistentFit
        The joint fit of the others.
    sharing : Sharing
        What experiments share.
    """
    known = {e.name: e for e in experiments}

    def with_causes(exclusion: Exclusion) -> Exclusion:
        experiment = known.get(exclusion.experiment)
        if experiment is None or (exclusion.evidence == "cause" and not exclusion.causes):
            return exclusion
        if exclusion.causes:
            if any(cause.kind == "exchanged data" for cause in exclusion.causes):
                return exclusion
            causes = _of_samples(experiment, experiments, agreed, sharing, beyond=True)
            return replace(exclusion, causes=causes) if causes else exclusion
        causes = _of_samples(experiment, experiments, agreed, sharing)
        if causes and exclusion.evidence in ("guess", "misfit"):
            if exclusion.evidence == "guess" and any(cause.kind in OF_GAIN for cause in causes):
                return exclusion
            return replace(exclusion, causes=causes, corrected=str(experiment.sysid.telemetry.path))
        # stretches say less than what was observed
        causes = tuple(cause for cause in causes if cause.kind != "stretches")
        single = alone.get(exclusion.experiment)
        if not causes and isinstance(single, IRLSResult) and not agreed.outcome.random_effects:
            causes = _of_parameters(experiment, single.whitened_runs[0], agreed, sharing)
        if not causes and exclusion.evidence == "misfit":
            return replace(exclusion, observations=(*exclusion.observations, *_odd_by_itself(experiment)))
        return replace(exclusion, causes=causes)

    return tuple(parallel_map(with_causes, list(left_out)))


def _odd_by_itself(experiment: Experiment) -> list[Cause]:
    """Return what is odd about a run that nothing explains, though it would do no harm in another."""
    message = noise_adaptation.readout_message(experiment)
    excess = [Cause(experiment.name, "o_1", "excess noise", words=message)] if message else []
    return list(command_jumps(experiment.sysid.telemetry)) or excess


def _of_samples(
    experiment: Experiment,
    experiments: Sequence[Experiment],
    agreed: _Agreement,
    sharing: Sharing,
    *,
    beyond: bool = False,
) -> tuple[Cause, ...]:
    """Return what its samples must be corrected for, so that an experiment agrees with the others.

    If it is to go `beyond` its parameters, it must explain more than any values of them.
    """
    if experiment.noise is None:
        return ()  # without it nothing tells what is too much
    agreeing = {e.name for e in agreed.experiments}  # whose channels are their own
    lenders = [e for e in experiments if e.name not in agreeing]
    trial = Trial(experiment, agreed.outcome, agreed.experiments, sharing)
    found = likeliest(trial, lenders, trial.as_it_is.left.free if beyond else np.inf)
    run = experiment.name
    return tuple(replace(h.cause, run=run) for h in found) if len(found) <= TOLD else ()


def _of_parameters(
    experiment: Experiment, block: whitened_run.WhitenedRun, agreed: _Agreement, sharing: Sharing
) -> tuple[Cause, ...]:
    """Return what would make an experiment agree with the others; empty if it does, or nothing would."""
    outcome = agreed.outcome
    names = tuple(p.name for p in outcome.parameters)
    share = sharing.matrix(experiment.sysid.telemetry, experiment.parameters, names)
    if not share.any(axis=1).all():
        return ()
    court = Court(
        (*agreed.experiments, experiment),
        (*outcome.whitened_runs, replace(block, parameter_map=share)),
        outcome,
        sharing,
    )
    test, last = consistency_test(court.experiments, outcome, court.whitened_runs), len(agreed.experiments)
    if test.of_runs([last]).p > ALARM and test.runs[last].noise_level == 1:
        return ()
    return named(court.case(test, last))


@dataclass(frozen=True)
class Court:
    """Experiments that do not agree, their blocks, the joint fit they were part of, and what they share."""

    experiments: tuple[Experiment, ...]
    whitened_runs: tuple[whitened_run.WhitenedRun, ...]
    outcome: IRLSResult
    sharing: Sharing

    def case(self, test: ConsistencyTest, i: int, gone: Iterable[int] = ()) -> Case:
        """Return the case of one of them, by number, without some others."""
        kept = [k for k in range(len(self.experiments)) if k not in gone]
        return Case(
            test=test.without(tuple(gone)),
            at=kept.index(i),
            experiments=tuple(self.experiments[k] for k in kept),
            whitened_runs=tuple(self.whitened_runs[k] for k in kept),
            sharing=self.sharing,
            outcome=self.outcome,
        )


def of_odd(test: ConsistencyTest, outliers: Sequence[int], court: Court) -> tuple[Exclusion, ...]:
    """Say of the outliers, by number, why they are left out."""
    rest, total = test.without(outliers).total, test.total
    names = [court.experiments[i].name for i in outliers]
    who, them = " and ".join(names), "them" if len(names) > 1 else "it"
    said = (
        f"{who} contradict{'s' * (len(names) == 1)} the others, which agree without {them}: chi2 among all "
        f"is {total.value:.4g} for {total.dof} degrees of freedom, among the others {rest.value:.4g} for "
        f"{rest.dof}"
    )
    found = []
    for i, name in zip(outliers, names, strict=True):
        others = [k for k in outliers if k != i]
        case = court.case(test, i, others)
        if len(others) == 1 and (exchange := exchanged(court.case(test, i), others[0])):
            causes: tuple[Cause, ...] = (exchange,)
        else:
            causes = () if case.agrees else named(case)
        apart = _apart(court.case(test, i) if case.agrees else case)  # from the other outliers, or from all
        evidence: Evidence = "cause" if causes else "sign"
        observation = Cause(name, "", "contradiction", words=f"{said}; {name} {apart}")
        found.append(Exclusion(name, (observation,), "rejected", "contradiction", evidence, causes))
    return tuple(found)


def _apart(case: Case) -> str:
    """Say which parameter of a run is farthest from where the others put it."""
    score, rest = case.score, case.test.without((case.at,))
    moved, covariance = rest.step(), rest.covariance()
    alone, sigmas = score.single_fit()
    best, said = 0.0, ""
    units = {p.name: p.unit for p in experiment_parameters(case.run.authority, 1).values()}
    for k, name in enumerate(dynamics.PARAMETERS):
        row = score.equation.parameter_map[k] * rest.width
        of_rest = score.run_theta[k] + float(score.equation.parameter_map[k] @ moved)
        sigma = float(np.sqrt(row @ covariance @ row))
        pull = abs(alone[k] - of_rest) / np.hypot(sigmas[k], sigma)
        if np.isfinite(pull) and pull > best:
            best, unit = pull, units.get(name, "1").removesuffix("1")
            said = (
                f"alone puts {name} at {alone[k]:.6g} ± {sigmas[k]:.1g}, the others at "
                f"{of_rest:.6g} ± {sigma:.1g} {unit}".rstrip()
            )
    return said
