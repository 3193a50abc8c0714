"""Why experiments are left out of the joint fit: the corrections of a run, ranked, as typed causes.

Every run that is left out is tested with all corrections. The best is named if nothing but noise remains with
it, together with those that the data do not distinguish from it. If one of these leaves more than noise, no
cause is named: none is better than a wrong one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from fit.consistency.consistency_test import ConsistencyTest
from fit.consistency.corrections import Candidate, segment_candidates, whole_run_candidates
from fit.consistency.run_test import MAX_EXCESS, Correction, RunTest
from fit.errors import FitError
from fit.false_alarms import p_limit
from fit.fitting import IRLSResult
from fit.model import Sharing
from fit.parallel import parallel_map
from fit.quality import Exclusion, noise_adaptation
from fit.units import campaign_unit, concise_value
from fit.warnings import Cause
from fit.whitening import Experiment

INDISTINCT = 10.0  # Delta chi^2 up to which the data do not distinguish two causes
MAX_CAUSES = 4  # that are named
SIMPLE = ("sign", "unit", "scale", "lag", "exchange", "jump")  # special cases of other kinds
GAIN_KINDS = ("sign", "unit", "scale")  # that an implausible gain alone suggests


class _JointFit(Protocol):
    """The joint fit of the runs that agree."""

    @property
    def outcome(self) -> IRLSResult: ...

    @property
    def experiments(self) -> tuple[Experiment, ...]: ...


@dataclass(frozen=True)
class _Rating:
    """A candidate, chi^2 with its correction and its cost, and whether nothing but noise remains."""

    candidate: Candidate
    chi2: float
    level: float
    is_noise: bool


def rank_causes(test: RunTest, lenders: Sequence[Experiment]) -> tuple[Cause, ...]:
    """Return the causes that explain a run and that the data do not distinguish, the likeliest first.

    Parameters
    ----------
    test : RunTest
        The run.
    lenders : sequence of Experiment
        Runs whose channels it may contain.
    """
    if test.recorded.is_noise:
        return ()

    def rate(candidate: Candidate) -> _Rating:
        corrected = test.corrected(candidate.correction)
        return _Rating(candidate, corrected.chi2 + candidate.cost, corrected.level, corrected.is_noise)

    ratings = [rate(candidate) for candidate in whole_run_candidates(test, lenders)]
    unexplained = test.recorded.chi2
    explained = min((rating.chi2 for rating in ratings if rating.is_noise), default=unexplained)
    min_gain = unexplained - explained - INDISTINCT if explained < unexplained else INDISTINCT
    ratings += [rate(candidate) for candidate in segment_candidates(test, min_gain)]
    # one that leaves less than noise fits noise
    ratings = [rating for rating in ratings if rating.level > 1 / MAX_EXCESS]
    if not ratings:
        return ()
    limit = INDISTINCT * max(1.0, min(rating.level for rating in ratings))
    ratings.sort(key=lambda rating: rating.chi2)
    likely = [rating for rating in ratings if rating.chi2 < ratings[0].chi2 + limit]
    if not all(rating.is_noise for rating in likely):
        return ()
    causes = _simplest([rating.candidate.cause for rating in likely])
    named = [cause for one in causes for cause in _authorities(one, test)]
    return tuple(replace(cause, run=test.experiment.name) for cause in named[:MAX_CAUSES])


def _simplest(causes: Sequence[Cause]) -> list[Cause]:
    """Return those of which no simpler or likelier one is of the same channel."""
    simple = {cause.channel for cause in causes if cause.kind in SIMPLE}
    remaining = [cause for cause in causes if cause.kind in SIMPLE or cause.channel not in simple]
    return list({(cause.kind, cause.channel): cause for cause in reversed(remaining)}.values())[::-1]


def _authorities(cause: Cause, test: RunTest) -> Iterator[Cause]:
    """Yield the authorities that make a stiffness that differs, then the cause itself."""
    if cause.kind == "stiffness" and cause.size is not None and cause.sigma is not None:
        j = int(cause.channel[-1])
        F, N = test.telemetry.authority[j - 1]
        for key, value, base, unit in (("F_max", F, "alpha_x", "N"), ("N_max", N, "alpha_phi", "N m")):
            alpha = test.parameters.get(f"{base}_{j}")
            size = value + cause.size / alpha if alpha else -1.0
            if alpha and size >= 0:
                words = f"its {key}_{j} is {size:.4g} and not {value:.4g} {unit}"
                yield Cause("", f"{key}_{j}", "authority", size, cause.sigma / abs(alpha), unit, words)
    yield cause


def explain_exclusions(
    exclusions: Sequence[Exclusion],
    experiments: Sequence[Experiment],
    single_fits: Mapping[str, IRLSResult | FitError],
    joint_fit: _JointFit,
    sharing: Sharing,
) -> tuple[Exclusion, ...]:
    """Return the exclusions with the causes that explain them.

    Parameters
    ----------
    exclusions : sequence of Exclusion
        Experiments that are left out.
    experiments : sequence of Experiment
        All that could be masked.
    single_fits : mapping of str to IRLSResult or FitError
        The fit of each of them by itself.
    joint_fit : ConsistentFit
        The joint fit of the others.
    sharing : Sharing
        What experiments share.
    """
    known = {e.name: e for e in experiments}
    consistent = {e.name for e in joint_fit.experiments}
    lenders = [e for e in experiments if e.name not in consistent]

    def run_test(name: str) -> RunTest | None:
        single, e = single_fits.get(name), known[name]
        single = single if isinstance(single, IRLSResult) else None
        if e.noise is None and single is None:
            return None
        return RunTest(e, joint_fit.outcome, joint_fit.experiments, sharing, single)

    names = [x.experiment for x in exclusions if x.experiment in known and x.evidence != "cause"]
    tests = dict(zip(names, parallel_map(run_test, names), strict=True))

    def explain(exclusion: Exclusion) -> Exclusion:
        test = tests.get(exclusion.experiment)
        if test is None or exclusion.evidence == "cause":
            return exclusion
        if exchange := _exchanged_data(exclusion, exclusions, tests):
            return replace(exclusion, causes=(exchange,))
        causes = rank_causes(test, lenders)
        if exclusion.evidence == "guess" and any(cause.kind in GAIN_KINDS for cause in causes):
            return exclusion
        if exclusion.evidence in ("guess", "misfit") and causes:
            return replace(exclusion, causes=causes, corrected=str(test.telemetry.path))
        if exclusion.evidence == "misfit":
            observations = (*exclusion.observations, *_peculiarities(test.experiment))
            return replace(exclusion, observations=observations)
        # segments are less specific than what was observed
        return replace(exclusion, causes=tuple(cause for cause in causes if cause.kind != "segments"))

    return tuple(parallel_map(explain, exclusions))


def _exchanged_data(
    exclusion: Exclusion, exclusions: Sequence[Exclusion], tests: Mapping[str, RunTest | None]
) -> Cause | None:
    """Return the exchange of data with another run that contradicts the others, None if there is none."""
    names = [x.experiment for x in exclusions if x.single_fit_code == "contradiction"]
    test = tests[exclusion.experiment]
    if test is None or exclusion.experiment not in names:
        return None
    for name in names:
        partner = tests[name]
        labels = _exchanged_labels(test, partner) if partner and partner is not test else []
        if labels:
            words = (
                f"its data and those of {name} look exchanged, each fits with the {' and '.join(labels)} of "
                "the other"
            )
            return Cause(exclusion.experiment, "", "exchanged data", words=words)
    return None


def _exchanged_labels(test: RunTest, partner: RunTest) -> list[str]:
    """Return the labels that differ between two runs if each run fits with those of the other."""
    a, b = test.telemetry, partner.telemetry
    differs = {
        "authority": a.authority != b.authority,
        "alignment epoch": a.alignment_epoch != b.alignment_epoch,
    }
    labels = [label for label, is_different in differs.items() if is_different]
    fits = labels and all(
        one.corrected(Correction(labels=run)).is_noise for one, run in ((test, b), (partner, a))
    )
    return labels if fits else []


def _peculiarities(experiment: Experiment) -> list[Cause]:
    """Return what is unusual about a run that nothing explains, though it is harmless in others."""
    message = noise_adaptation.readout_message(experiment)
    return [Cause(experiment.name, "o_1", "excess noise", words=message)] if message else []


def contradiction_exclusions(
    test: ConsistencyTest,
    outliers: Sequence[int],
    experiments: Sequence[Experiment],
    probabilities: Mapping[str, float],
) -> tuple[Exclusion, ...]:
    """Return the runs that contradict the others, with what they contradict.

    Parameters
    ----------
    test : ConsistencyTest
        All runs.
    outliers : sequence of int
        Those that contradict the others, by number.
    experiments : sequence of Experiment
        All runs.
    probabilities : mapping of str to float
        By run, that it contradicts the others.
    """
    total, rest = test.total, test.without(outliers).total
    names = [test.runs[i].name for i in outliers]
    observation = (
        f"{' and '.join(names)} contradict{'s' * (len(names) == 1)} the others, which agree without "
        f"{'them' if len(names) > 1 else 'it'}: chi2 among all is {total.value:.4g} for "
        f"{total.dof} degrees of freedom, among the others {rest.value:.4g} for {rest.dof}"
    )
    exclusions = []
    for i, name in zip(outliers, names, strict=True):
        numbers = [k for k in outliers if k != i]
        remaining = test.without(numbers)
        position = i - sum(k < i for k in numbers)
        agrees = test.runs[i].noise_level == 1 and remaining.of_runs([position]).p > p_limit("runs")
        # from the other outliers, or from all
        largest = (
            largest_pull(test, i, experiments[i])
            if agrees
            else largest_pull(remaining, position, experiments[i])
        )
        cause = Cause(name, "", "contradiction", words=f"{observation}; {name} {largest}")
        exclusions.append(
            Exclusion(name, (cause,), "rejected", "contradiction", probability=probabilities.get(name))
        )
    return tuple(exclusions)


def largest_pull(test: ConsistencyTest, i: int, experiment: Experiment) -> str:
    """Describe the parameter of a run that differs most from what the others determine, in sigmas."""
    score, rest = test.runs[i], test.without((i,))
    theta = score.run_theta + score.equation.parameter_map @ rest.step()
    share = score.equation.parameter_map * rest.width
    sigma = np.sqrt(np.einsum("ij,jk,ik->i", share, rest.covariance(), share))
    single, single_sigma = score.single_fit()
    names = score.equation.names
    n = len(names)
    shared = sigma[:n] > 0  # the others have no delta_ifo of an epoch that they do not belong to
    pulls = np.where(shared, np.abs(single[:n] - theta[:n]) / np.hypot(single_sigma[:n], sigma[:n]), 0.0)
    if not np.any(pulls > 0):
        return "agrees with them"
    k = int(np.argmax(pulls))
    name, run = names[k], experiment.sysid
    units = {p.name: p.unit for p in run.spacecraft.parameters(run.telemetry, experiment.parameters)}
    return (
        f"alone puts {name} at {concise_value(single[k], single_sigma[k])}, the others at "
        f"{concise_value(theta[k], sigma[k])} {campaign_unit(units.get(name, '1'))}"
    ).rstrip()
