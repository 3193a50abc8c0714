"""Which experiments belong into one joint fit: a table of checks of files and samples, without any fit."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, groupby

import numpy as np
from numpy.typing import NDArray

from fit.findings import Finding
from fit.parallel import parallel_map
from fit.quality import duplicates, samples, saturation
from fit.quality.channel_units import unit_faults
from fit.quality.exchanged_channels import exchange_faults
from fit.quality.injections import has_injections
from fit.quality.loop_response import response_faults
from fit.quality.plausibility import level_faults
from fit.telemetry import Telemetry
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]
Find = Callable[[Sequence[Experiment]], Iterable[Finding]]

SETTINGS = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch")


def find_faults(experiments: Sequence[Experiment]) -> list[Finding]:
    """Return what is wrong with the files of experiments, before any fit."""
    return [finding for find in CHECKS.values() for finding in find(experiments)]


def _per_experiment(
    find: Callable[[Experiment], Iterable[Finding]],
) -> Callable[[Sequence[Experiment]], Iterator[Finding]]:
    """Return the check of many experiments that applies one to each of them."""

    def check(experiments: Sequence[Experiment]) -> Iterator[Finding]:
        found = parallel_map(lambda e: list(find(e)), experiments, Experiment.samples)
        return chain.from_iterable(found)

    return check


def _runs(e: Experiment) -> list[Run]:
    return [e.sysid, e.noise] if e.noise else [e.sysid]


def _sample_faults(experiments: Sequence[Experiment]) -> Iterator[Finding]:
    """Yield the faults of the samples of both runs of the experiments."""
    n_channels = sum(len(run.channels.series) for e in experiments for run in _runs(e))

    def find(e: Experiment) -> Iterator[Finding]:
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


def _authority_faults(e: Experiment) -> Iterator[Finding]:
    """Yield what contradicts the authorities of both runs of an experiment."""
    return chain.from_iterable(saturation.check_authority(run.telemetry) for run in _runs(e))


def _settings_mismatches(e: Experiment) -> Iterator[Finding]:
    """Yield the attribute in which a noise run differs from the run whose noise it should be."""
    noise, sysid = (e.noise or e.sysid).telemetry, e.sysid.telemetry
    for key in SETTINGS:
        value, expected = getattr(noise, key), getattr(sysid, key)
        if not math.isclose(value, expected, rel_tol=1e-6):
            message = (
                f"{noise.path}: attribute {key}: {value:g}, expected {expected:g} as in {sysid.path}, whose "
                "noise run it is"
            )
            yield Finding("invalid_data", message, noise.run, key)
            return


def _noise_runs_with_injections(e: Experiment) -> Iterator[Finding]:
    """Yield the wrong label of the noise run of an experiment that holds injections."""
    if e.noise and has_injections(e.noise, e.sysid):
        run = e.noise.telemetry
        message = f"{run.path}: attribute kind: 'noise', but the run contains injections, expected 'sysid'"
        yield Finding("invalid_data", message, run.run, "kind")


def _duplicate_noise(experiments: Sequence[Experiment]) -> Iterator[Finding]:
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
        finding = _duplicate_finding(a.telemetry, b.telemetry, readouts)
        yield from (replace(finding, run=name) for name in names)


def _duplicate_finding(a: Telemetry, b: Telemetry, readouts: Sequence[duplicates.DuplicatePair]) -> Finding:
    pair = readouts[0]
    late = f", {abs(pair.lag):g} s {'later' if pair.lag > 0 else 'earlier'}" * (abs(pair.lag) > 0.5)
    scaled = f", times {pair.gain:.4g}" * (abs(pair.gain - 1) > 1e-3)
    names = [readout.channel for readout in readouts]
    message = (
        f"{b.path}: {' and '.join(names)} contain{'s' * (len(names) == 1)} the same noise as {a.path}{late}"
        f"{scaled}: {b.run} and {a.run} cannot be two runs"
    )
    return Finding("invalid_data", message, b.run, " ".join(names))


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


#: The checks of the files of a campaign; the earliest that finds a fault of an experiment names it.
CHECKS: Mapping[str, Find] = {
    "duplicate noise": _duplicate_noise,
    "units of channels": _per_experiment(unit_faults),
    "exchanged channels": _per_experiment(exchange_faults),
    "levels of the test masses": _per_experiment(level_faults),
    "attributes of noise runs": _per_experiment(_settings_mismatches),
    "authority": _per_experiment(_authority_faults),
    "injections in noise runs": _per_experiment(_noise_runs_with_injections),
    "samples": _sample_faults,
    "response to guidance": response_faults,
}
