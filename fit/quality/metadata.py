"""Which experiments belong into one joint fit: a table of checks of files and samples, without any fit.

An experiment with a fault is excluded by name. What most of the experiments have in common is a property of
the archive: of some kinds of faults it becomes a warning of the joint fit instead.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, groupby

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.parallel import parallel_map
from fit.quality import duplicates, samples, saturation
from fit.quality.channel_units import unit_faults
from fit.quality.exchanged_channels import exchange_faults
from fit.quality.exclusions import Evidence, Exclusion, join_messages
from fit.quality.initial_fit import initial_noise_psd
from fit.quality.loop_response import response_faults
from fit.quality.plausibility import level_faults
from fit.telemetry import Telemetry
from fit.warnings import Cause, FitWarning
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]

SETTINGS = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch")
MIN_EXPERIMENTS = 3  # of which more than half may have a fault in common
MAX_CAUSES = 2  # of an experiment that its exclusion names
MAX_INJECTION = 0.06  # Hz: up to here injections are looked for
SEGMENT = 2048.0  # s
LINE_RATIO, MEDIAN_BINS = 12.0, 31  # power of a sine over the median of so many bins about it; noise has 6
INJECTION_RATIO = 300.0  # of powers in such a segment; noise that differs makes 25, an injected sine 1e4


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


@dataclass(frozen=True)
class Check:
    """A test of the files of experiments.

    Attributes
    ----------
    find : callable
        Yields the faults of experiments, as exclusions with one observation each.
    codes : mapping of str to str
        By kind of a fault, the code of the warning instead if most of the experiments have it.
    """

    find: Callable[[Sequence[Experiment]], Iterable[Exclusion]]
    codes: Mapping[str, str] = field(default_factory=dict)

    def apply(self, experiments: Sequence[Experiment]) -> ScreeningReport:
        """Return the exclusions, one of each experiment, and what most of the experiments have in common."""
        by_code: dict[str, list[Exclusion]] = {}
        for fault in self.find(experiments):
            by_code.setdefault(self.codes.get(fault.observations[0].kind, ""), []).append(fault)
        exclusions: dict[str, Exclusion] = {}
        notes = []
        for code, faults in by_code.items():
            n_faulty = len({fault.experiment for fault in faults})
            is_common = n_faulty >= MIN_EXPERIMENTS and 2 * n_faulty > len(experiments)
            if code and is_common:
                causes = tuple(cause for fault in faults for cause in fault.observations)
                message = f"most of the experiments have a fault in common: {join_messages(faults)}"
                notes.append(FitWarning(code, (), message, causes=causes))
                continue
            for fault in faults:
                exclusion = exclusions.setdefault(fault.experiment, replace(fault, observations=()))
                causes = (*exclusion.observations, *fault.observations)
                exclusions[fault.experiment] = replace(exclusion, observations=causes[:MAX_CAUSES])
        return ScreeningReport(list(exclusions.values()), notes)


def screen(experiments: Sequence[Experiment]) -> ScreeningReport:
    """Return the faults that keep experiments out of a joint fit, and those that most of them share."""
    reports = [check.apply(experiments) for check in CHECKS.values()]
    exclusions: dict[str, Exclusion] = {}
    # what a gain far from 1 suggests comes after faults that were observed
    rank = {"guess": 1, "misfit": 2}
    for fault in sorted(
        chain.from_iterable(r.exclusions for r in reports), key=lambda x: rank.get(x.evidence, 0)
    ):
        exclusions.setdefault(fault.experiment, fault)
    return ScreeningReport(list(exclusions.values()), [note for r in reports for note in r.notes])


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
    n_channels = sum(len(_channels(run)) for e in experiments for run in _runs(e))

    def find(e: Experiment) -> Iterator[Cause]:
        read_outs, names = e.sysid.spacecraft.read_outs, _channels(e.sysid)
        runs = [run.telemetry.select(_channels(run)) for run in _runs(e)]
        commands = [n for n in names if n not in read_outs and e.noise and _is_noisy(runs[-1], n)]
        for run in map(_unsaturated, runs):
            present = [name for name in commands if name in run.channels]
            yield from samples.check_samples(run, read_outs, (*read_outs, *present), n_channels)
        noises = [initial_noise_psd(e, k) for k in range(len(e.sysid.equations))]
        if fault := samples.rounding_fault(e.sysid, noises, names):
            yield fault

    return _per_experiment(find)(experiments)


def _channels(run: Run) -> list[str]:
    """Return the read-outs of a run and the commands that it has."""
    commands = (name for name in run.spacecraft.commands if name in run.channels.series)
    return [*run.spacecraft.read_outs, *commands]


def _is_noisy(run: Telemetry, name: str) -> bool:
    return name in run.channels and samples.is_noisy(run.channels[name])


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
    """Yield the attributes in which a noise run differs from the run whose noise it should be."""
    if e.noise is None:
        return
    noise, sysid = e.noise.telemetry, e.sysid.telemetry
    for key in SETTINGS:
        value, expected = getattr(noise, key), getattr(sysid, key)
        if not math.isclose(value, expected, rel_tol=1e-6):
            words = (
                f"attribute {key}: {value:g}, expected {expected:g} as in {sysid.path}, whose noise run it is"
            )
            yield Cause(noise.run, key, "attribute", float(value), words=words, file=str(noise.path))
            return


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
        cause = _duplicate_cause(a.telemetry, b.telemetry, readouts)
        names = _mislabelled_owners(e, a, copy, b, whole=len(readouts) == 2)
        excluded |= set(names)
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
        is_sysid = sysid.noise is None or _injected_readout(sysid.sysid, sysid.noise)
        return [noise.name if is_sysid else sysid.name]
    if whole and all(getattr(a.telemetry, key) == getattr(b.telemetry, key) for key in SETTINGS):
        return [copy.name]
    return [e.name, copy.name]


def _paired_injections(e: Experiment) -> list[Cause]:
    """Return the wrong label of the noise run of an experiment that holds injections."""
    if e.noise is None or not (readout := _injected_readout(e.noise, e.sysid)):
        return []
    words = f"attribute kind: 'noise', but {readout} contains injections, expected 'sysid'"
    return [Cause(e.noise.telemetry.run, "kind", "attribute", words=words, file=str(e.noise.telemetry.path))]


def _injected_readout(run: Run, reference: Run) -> str:
    """Return the read-out in which a run is louder than another as only injections make it, or nothing."""
    for name in run.spacecraft.read_outs:
        f, power = _curvature_psd(run.channels.series[name], run.channels.fs)
        level = scipy.ndimage.median_filter(power, MEDIAN_BINS, mode="nearest")
        noise = np.interp(f, *_curvature_psd(reference.channels.series[name], reference.channels.fs))
        band = (f > 2 / SEGMENT) & (f < MAX_INJECTION)
        lines = band & (power > LINE_RATIO * level) & (power > INJECTION_RATIO * noise)
        if np.all(noise[band] > 0) and lines.any():  # next to a run without noise any run is louder
            return name
    return ""


def _curvature_psd(x: Array, fs: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and the averaged PSD of the second differences of a series."""
    curvature = np.diff(x, 2)
    f, power = scipy.signal.welch(curvature, fs, nperseg=min(curvature.size, int(SEGMENT * fs)))
    return np.asarray(f), np.asarray(power)


#: The checks of the files of a campaign; an experiment is excluded by the earliest that finds a fault.
CHECKS: Mapping[str, Check] = {
    "duplicate noise": Check(_duplicate_noise),
    "units of channels": Check(_unit_faults),
    "exchanged channels": Check(_per_experiment(exchange_faults, evidence="cause")),
    "levels of the test masses": Check(
        lambda experiments: chain.from_iterable(map(level_faults, experiments))
    ),
    "attributes of noise runs": Check(_per_experiment(_settings_mismatches)),
    "authority": Check(_per_experiment(_authority_faults)),
    "injections in noise runs": Check(_per_experiment(_paired_injections, evidence="cause")),
    "samples": Check(_sample_faults, samples.CODES),
    "response to guidance": Check(response_faults, dict.fromkeys(("scale", "sign"), "guidance_scale")),
}
