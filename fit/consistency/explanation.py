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
from fit.fitting import IRLSResult, louder
from fit.model import Sharing, dynamics
from fit.parallel import parallel_map
from fit.parameters import experiment_parameters
from fit.quality import Exclusion, Tells, samples
from fit.whitening import Experiment, whitened_run

MENDED = "so mended, the run says what the others say"
ALARM = 1e-4  # p-value below which a run contradicts the others
UNTOLD = "no single cause that was tried explains it"
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
    plain = {h.words.split()[0] for h in alike if h.kind in PLAIN}
    kept = [h for h in alike if h.kind in PLAIN or h.words.split()[0] not in plain]
    return list({(h.kind, h.words.split()[0]): h for h in reversed(kept)}.values())[::-1]


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

    def anew(f: Exclusion) -> Exclusion:
        experiment, own = known.get(f.experiment), alone.get(f.experiment)
        if experiment is None or (f.tells == "cause" and not f.perhaps):
            return f
        if f.perhaps:
            alike = _of_samples(experiment, experiments, agreed, sharing, beyond=True)
            better = f"{f.experiment}: perhaps its {_either(alike)}"
            return replace(f, reason=f.reason.replace(f.perhaps, better)) if alike else f
        alike = _of_samples(experiment, experiments, agreed, sharing)
        if alike and f.tells in ("guess", "misfit"):
            if f.tells == "guess" and any(h.kind in OF_GAIN for h in alike):
                return f
            path = experiment.sysid.telemetry.path
            return replace(f, reason=f"{path}: {_either(alike)}; {MENDED}")
        alike = [h for h in alike if h.kind != "stretches"]  # which says less than what was seen
        cause = f"its {_either(alike)}" if alike else ""
        if not cause and isinstance(own, IRLSResult) and not agreed.outcome.departing:
            cause = _of_parameters(experiment, own.blocks[0], agreed, sharing)
        if not cause and f.tells == "misfit":
            return replace(f, reason="; ".join([f.reason, *_odd_by_itself(experiment)]))
        reason = f.reason.removesuffix(f"; {UNTOLD}")
        return replace(f, reason=f"{reason}; perhaps {cause}") if cause else f

    return tuple(parallel_map(anew, list(left_out)))


def _odd_by_itself(experiment: Experiment) -> list[str]:
    """Return what is odd about a run that nothing explains, though it would do no harm in another."""
    wild = list(samples.of_commands(experiment.sysid.telemetry))
    return wild or [told for told in (louder.told(experiment),) if told]


def _either(alike: Sequence[Hypothesis]) -> str:
    return ", or ".join(dict.fromkeys(h.words for h in alike))


def _of_samples(
    experiment: Experiment,
    experiments: Sequence[Experiment],
    agreed: _Agreement,
    sharing: Sharing,
    *,
    beyond: bool = False,
) -> list[Hypothesis]:
    """Return what its samples, mended, would make an experiment say what the others say.

    If it is to go `beyond` its parameters, it must explain more than any values of them.
    """
    if experiment.noise is None:
        return []  # without it nothing tells what is too much
    agreeing = {e.name for e in agreed.experiments}  # whose channels are their own
    lenders = [e for e in experiments if e.name not in agreeing]
    trial = Trial(experiment, agreed.outcome, agreed.experiments, sharing)
    found = likeliest(trial, lenders, trial.as_it_is.left.free if beyond else np.inf)
    return found if len(found) <= TOLD else []


def _of_parameters(
    experiment: Experiment, block: whitened_run.WhitenedRun, agreed: _Agreement, sharing: Sharing
) -> str:
    """Return what would make an experiment say what the others say; empty if it does, or nothing would."""
    outcome = agreed.outcome
    names = tuple(p.name for p in outcome.parameters)
    share = sharing.matrix(experiment.sysid.telemetry, experiment.parameters, names)
    if not share.any(axis=1).all():
        return ""
    court = Court(
        (*agreed.experiments, experiment), (*outcome.blocks, replace(block, share=share)), outcome, sharing
    )
    test, last = consistency_test(court.experiments, outcome, court.blocks), len(agreed.experiments)
    if test.of_runs([last]).p > ALARM and test.runs[last].noise_level == 1:
        return ""
    return named(court.case(test, last))


@dataclass(frozen=True)
class Court:
    """Experiments that do not agree, their blocks, the joint fit they were part of, and what they share."""

    experiments: tuple[Experiment, ...]
    blocks: tuple[whitened_run.WhitenedRun, ...]
    outcome: IRLSResult
    sharing: Sharing

    def case(self, test: ConsistencyTest, i: int, gone: Iterable[int] = ()) -> Case:
        """Return the case of one of them, by number, without some others."""
        kept = [k for k in range(len(self.experiments)) if k not in gone]
        return Case(
            test=test.without(tuple(gone)),
            at=kept.index(i),
            experiments=tuple(self.experiments[k] for k in kept),
            blocks=tuple(self.blocks[k] for k in kept),
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
        perhaps = ""
        if len(others) == 1 and (labels := exchanged(court.case(test, i), others[0])):
            cause = f"{who}: each fits with the {labels} of the other, their data look exchanged"
        else:
            likely = "" if case.agrees else named(case)
            cause = perhaps = f"{name}: perhaps {likely}" if likely else ""
        apart = _apart(court.case(test, i) if case.agrees else case)  # from the other outliers, or from all
        reason = f"{cause}; " * bool(cause) + f"{said}; {name} {apart}"
        untold = "" if cause else f"; {UNTOLD}"
        tells: Tells = "cause" if cause else "sign"
        found.append(Exclusion(name, reason + untold, own="contradiction", tells=tells, perhaps=perhaps))
    return tuple(found)


def _apart(case: Case) -> str:
    """Say which parameter of a run is farthest from where the others put it."""
    score, rest = case.score, case.test.without((case.at,))
    moved, covariance = rest.step(), rest.covariance()
    alone, sigmas = score.single_fit()
    best, said = 0.0, ""
    units = {p.name: p.unit for p in experiment_parameters(case.run.authority, 1).values()}
    for k, name in enumerate(dynamics.PARAMETERS):
        row = score.equation.share[k] * rest.width
        of_rest = score.run_theta[k] + float(score.equation.share[k] @ moved)
        sigma = float(np.sqrt(row @ covariance @ row))
        pull = abs(alone[k] - of_rest) / np.hypot(sigmas[k], sigma)
        if np.isfinite(pull) and pull > best:
            best, unit = pull, units.get(name, "1").removesuffix("1")
            said = (
                f"alone puts {name} at {alone[k]:.6g} ± {sigmas[k]:.1g}, the others at "
                f"{of_rest:.6g} ± {sigma:.1g} {unit}".rstrip()
            )
    return said
