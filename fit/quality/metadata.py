"""Which experiments belong into one joint fit: a table of checks of files and samples, without any fit.

An experiment with a fault is excluded by name. What most of the experiments have in common is a property of
the archive: of some kinds of faults it becomes a warning of the joint fit instead.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby

import numpy as np
from numpy.typing import NDArray

from fit.parallel import parallel_map
from fit.quality import duplicates, samples, saturation
from fit.quality.channel_units import unit_faults
from fit.quality.exchanged_channels import exchange_faults
from fit.quality.exclusions import Evidence, Exclusion, join_messages
from fit.quality.injections import has_injections
from fit.quality.loop_response import response_faults
from fit.quality.plausibility import level_faults
from fit.telemetry import Telemetry
from fit.warnings import Cause, FitWarning
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]
Find = Callable[[Sequence[Experiment]], Iterable[Exclusion]]

SETTINGS = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch")
MIN_EXPERIMENTS = 3  # of which more than half may have a fault in common
MAX_CAUSES = 2  # of an experiment that its exclusion names


@dataclass(frozen=True)
class ScreeningReport:
    """Faults of the files of experiments.

    Attributes
    ----------
    exclusions : list of Exclusion
        One of each faulty experiment.
    notes : list of FitWarning
        Faults that most of them have in common.
    """

    exclusions: list[Exclusion]
    notes: list[FitWarning]


def screen(experiments: Sequence[Experiment]) -> ScreeningReport:
    """Return the faults that keep experiments out of a joint fit, and those that most of them share."""
    reports = [apply_check(find, codes, experiments) for find, codes in CHECKS.values()]
    exclusions: dict[str, Exclusion] = {}
    # what a gain far from 1 suggests comes after faults that were observed
    rank = {"guess": 1, "misfit": 2}
    of_all = chain.from_iterable(r.exclusions for r in reports)
    for fault in sorted(of_all, key=lambda x: rank.get(x.evidence, 0)):
        exclusions.setdefault(fault.experiment, fault)
    return ScreeningReport(list(exclusions.values()), [note for r in reports for note in r.notes])


def apply_check(find: Find, codes: Mapping[str, str], experiments: Sequence[Experiment]) -> ScreeningReport:
    """Return what a check finds: exclusions, one of each experiment, and what most of them have in common."""
    by_code: dict[str, list[Exclusion]] = {}
    for fault in find(experiments):
        by_code.setdefault(codes.get(fault.observations[0].kind, ""), []).append(fault)
    exclusions: dict[str, Exclusion] = {}
    notes = []
    for code, faults in by_code.items():
        n_faulty = len({fault.experiment for fault in faults})
        if code and n_faulty >= MIN_EXPERIMENTS and 2 * n_faulty > len(experiments):
            causes = tuple(cause for fault in faults for cause in fault.observations)
            message = f"most of the experiments have a fault in common: {join_messages(faults)}"
            notes.append(FitWarning(code, (), message, causes=causes))
            continue
        for fault in faults:
            exclusion = exclusions.setdefault(fault.experiment, replace(fault, observations=()))
            causes = (*exclusion.observations, *fault.observations)
            exclusions[fault.experiment] = replace(exclusion, observations=causes[:MAX_CAUSES])
    return ScreeningReport(list(exclusions.values()), notes)


def _per_experiment(
    find: Callable[[Experiment], Iterable[Cause]], evidence: Evidence = "sign"
) -> Callable[[Sequence[Experiment]], Iterator[Exclusion]]:
    """Return the check of many experiments that applies one to each of them."""

    def check(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
        causes = parallel_map(lambda e: list(find(e)), experiments, Experiment.samples)
        for e, faults in zip(experiments, causes, strict=True):
            yield from (Exclusion(e.name, (cause,), evidence=evidence) for cause in faults)

    return check


def _runs(e: Experiment) -> list[Run]:
    return [e.sysid, e.noise] if e.noise else [e.sysid]


def _unit_faults(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the channels in a wrong unit or with a wrong sign."""
    faults = parallel_map(lambda e: list(unit_faults(e)), experiments, Experiment.samples)
    return chain.from_iterable(faults)


def _sample_faults(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the faults of the samples of both runs of the experiments."""
    n_channels = sum(len(run.channels.series) for e in experiments for run in _runs(e))

    def find(e: Experiment) -> Iterator[Cause]:
        read_outs = e.sysid.spacecraft.read_outs
        runs = [_unsaturated(run.telemetry) for run in _runs(e)]
        commands = [
            name
            for name in e.sysid.spacecraft.commands
            if name in e.sysid.channels.series
            and e.noise
            and name in runs[-1].channels
            and samples.is_noisy(e.noise.telemetry.channels[name])
        ]
        for run in runs:
            present = [name for name in commands if name in run.channels]
            yield from samples.check_samples(run, read_outs, (*read_outs, *present), n_channels)

    return _per_experiment(find)(experiments)


def _unsaturated(run: Telemetry) -> Telemetry:
    """Return a run without the commands that are at their limits: those are masked, and no fault."""
    commands = {
        name: np.where(saturation.at_limit(run.channels[name], limit), np.nan, run.channels[name])
        for name, limit in saturation.limits(run).items()
    }
    return replace(run, channels={**run.channels, **commands})


def _authority_faults(e: Experiment) -> Iterator[Cause]:
    """Yield what contradicts the authorities of both runs of an experiment."""
    return chain.from_iterable(saturation.check_authority(run.telemetry) for run in _runs(e))


def _settings_mismatches(e: Experiment) -> Iterator[Cause]:
    """Yield the attribute in which a noise run differs from the run whose noise it should be."""
    noise, sysid = (e.noise or e.sysid).telemetry, e.sysid.telemetry
    for key in SETTINGS:
        value, expected = getattr(noise, key), getattr(sysid, key)
        if not math.isclose(value, expected, rel_tol=1e-6):
            words = (
                f"attribute {key}: {value:g}, expected {expected:g} as in {sysid.path}, whose noise run it is"
            )
            yield Cause(noise.run, key, "attribute", float(value), words=words, file=str(noise.path))
            return


def _noise_runs_with_injections(e: Experiment) -> Iterator[Cause]:
    """Yield the wrong label of the noise run of an experiment that holds injections."""
    if e.noise and has_injections(e.noise, e.sysid):
        run = e.noise.telemetry
        words = "attribute kind: 'noise', but the run contains injections, expected 'sysid'"
        yield Cause(run.run, "kind", "attribute", words=words, file=str(run.path))


def _duplicate_noise(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments that hold samples of another run, or of another of their own."""
    owners = [(e, run) for e in experiments for run in _runs(e)]
    pairs = sorted(duplicates.duplicate_pairs([run for _, run in owners]), key=lambda pair: pair.runs)
    excluded: set[str] = set()
    for (i, j), group in groupby(pairs, key=lambda pair: pair.runs):
        readouts = list(group)
        (e, a), (copy, b) = owners[i], owners[j]
        if excluded & {e.name, copy.name}:
            continue
        names = _mislabelled_owners(e, a, copy, b, whole=len(readouts) == 2)
        excluded |= set(names)
        cause = _duplicate_cause(a.telemetry, b.telemetry, readouts)
        yield from (Exclusion(name, (cause,)) for name in names)


def _duplicate_cause(a: Telemetry, b: Telemetry, readouts: Sequence[duplicates.DuplicatePair]) -> Cause:
    pair = readouts[0]
    late = f", {abs(pair.lag):g} s {'later' if pair.lag > 0 else 'earlier'}" * (abs(pair.lag) > 0.5)
    scaled = f", times {pair.gain:.4g}" * (abs(pair.gain - 1) > 1e-3)
    names = [readout.channel for readout in readouts]
    words = (
        f"{' and '.join(names)} contain{'s' * (len(names) == 1)} the same noise as {a.path}{late}{scaled}: "
        f"{b.run} and {a.run} cannot be two runs"
    )
    return Cause(b.run, " ".join(names), "duplicate", words=words, file=str(b.path))


def _mislabelled_owners(e: Experiment, a: Run, copy: Experiment, b: Run, *, whole: bool) -> list[str]:
    """Return the experiments to leave out for two runs that share their noise.

    Which of two that state different things is right is not known: then both are left out.
    """
    kinds = a.telemetry.kind, b.telemetry.kind
    if e is copy:
        return [e.name]
    if kinds[0] != kinds[1]:  # a noise run that is another experiment, or an experiment that is noise
        sysid, noise = (e, copy) if kinds[0] == "sysid" else (copy, e)
        is_sysid = sysid.noise is None or has_injections(sysid.sysid, sysid.noise)
        return [noise.name if is_sysid else sysid.name]
    if whole and all(getattr(a.telemetry, key) == getattr(b.telemetry, key) for key in SETTINGS):
        return [copy.name]
    return [e.name, copy.name]


#: The checks of the files of a campaign, and by kind of a fault the code of the warning instead if most
#: experiments have it. An experiment is excluded by the earliest that finds a fault.
CHECKS: Mapping[str, tuple[Find, Mapping[str, str]]] = {
    "duplicate noise": (_duplicate_noise, {}),
    "units of channels": (_unit_faults, {}),
    "exchanged channels": (_per_experiment(exchange_faults, evidence="cause"), {}),
    "levels of the test masses": (lambda campaign: chain.from_iterable(map(level_faults, campaign)), {}),
    "attributes of noise runs": (_per_experiment(_settings_mismatches), {}),
    "authority": (_per_experiment(_authority_faults), {}),
    "injections in noise runs": (_per_experiment(_noise_runs_with_injections, evidence="cause"), {}),
    "samples": (_sample_faults, samples.CODES),
    "response to guidance": (response_faults, dict.fromkeys(("scale", "sign"), "guidance_scale")),
}
