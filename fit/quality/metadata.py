"""Which experiments belong into one fit: what their files say of themselves, held against each other.

Nothing is fitted here. What contradicts itself stays out of the joint fit by name; where two runs are one,
the first stays, if both say the same of it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from itertools import chain

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.parallel import parallel_map
from fit.quality import authority, constancy, duplicates, rounding, samples
from fit.quality.channel_units import unit_faults
from fit.quality.exclusions import Exclusion
from fit.quality.jumps import command_jumps
from fit.quality.loop_response import response_faults
from fit.spectra import derivatives
from fit.telemetry import Telemetry, utc
from fit.warnings import FitWarning
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]

SETTINGS = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch")
MAX_GAP = 30 * 86400.0  # s between a run and its noise run, where most are adjacent
ADJACENT = 86400.0  # s
SAMPLE_CODES = (
    "coarse_quantisation",
    "suspect_samples",
    "interpolated",
)  # warnings about samples, where most experiments have the same fault
MIN_EXPERIMENTS = 3  # experiments; what more than half of so many have is a property of the archive
MAX_INJECTION = 0.06  # Hz: up to here injections are looked for
SEGMENT = 2048.0  # s
LINE_RATIO, MEDIAN_BINS = 12.0, 31  # power of a sine over the median of so many bins about it; noise has 6
INJECTION_RATIO = 300.0  # ratio of power in such a segment; noise that differs makes 25, an injected sine 1e4


@dataclass(frozen=True)
class ScreeningReport:
    """Faults of the files of experiments.

    Attributes
    ----------
    exclusions : list of Exclusion
        Faulty experiments, one reason for each.
    notes : list of FitWarning
        Faults that most of them have in common.
    """

    exclusions: list[Exclusion]
    notes: list[FitWarning]


def screen(experiments: Sequence[Experiment]) -> ScreeningReport:
    """Return the faults that keep experiments out of a joint fit, and those that most of them share."""
    units = parallel_map(lambda e: list(unit_faults(e)), experiments, Experiment.samples)
    # a gain that no unit explains is a sign of other faults, which come first
    unexplained = [fault for faults in units for fault in faults if fault.tells == "misfit"]
    exclusions = [*_duplicate_noise(experiments)]
    exclusions += [fault for faults in units for fault in faults if fault.tells != "misfit"]
    exclusions += [*_settings_mismatches(experiments), *_distant_noise_runs(experiments)]
    samples_of = parallel_map(_screen_samples, experiments, Experiment.samples)
    by_name = {e.name: report for e, report in zip(experiments, samples_of, strict=True)}
    exclusions += [Exclusion(n, reason) for n, report in by_name.items() for reason in report.authority]
    exclusions += _noise_runs_with_injections(experiments)
    reasons = {code: {n: r.faults[code] for n, r in by_name.items()} for code in SAMPLE_CODES}
    reasons["guidance_scale"] = {f.experiment: [f.reason] for f in response_faults(experiments)}
    reports = [_faults_of_few(experiments, texts, code) for code, texts in reasons.items()]
    exclusions += [*chain.from_iterable(report.exclusions for report in reports), *unexplained]
    notes = [note for report in reports for note in report.notes]
    notes += [note for report in by_name.values() for note in report.notes]
    return ScreeningReport(_first_reasons(exclusions), notes)


def mislabelled(experiments: Sequence[Experiment], telemetries: Sequence[Telemetry]) -> list[Exclusion]:
    """Return the noise runs of no experiment that hold injections: those of one, if the label were right."""
    names = {e.name for e in experiments}
    alone = [t for t in telemetries if t.kind == "noise" and t.experiment not in names]
    noise = [e.noise for e in experiments if e.noise]
    told = parallel_map(partial(_injected_channel, noise), alone)
    return [
        Exclusion(
            run.experiment,
            f"{run.path}: attribute kind: 'noise', but {name} holds injections, expected 'sysid'",
            tells="cause",
        )
        for run, name in zip(alone, told, strict=True)
        if name
    ]


def changes(experiments: Sequence[Experiment]) -> ScreeningReport:
    """Return the experiments, glitches masked, of which parts obey different equations."""
    breaks = parallel_map(_structural_break, experiments, Experiment.samples)
    reasons = {e.name: texts for e, texts in zip(experiments, breaks, strict=True)}
    report = _faults_of_few(experiments, reasons, "structural_break")
    return replace(report, exclusions=[replace(f, tells="misfit") for f in report.exclusions])


@dataclass(frozen=True)
class _SampleReport:
    """Commands beyond the authority, notes on rounding, and faults of samples by their code."""

    authority: list[str]
    notes: list[FitWarning]
    faults: Mapping[str, list[str]]


def _screen_samples(e: Experiment) -> _SampleReport:
    runs = [run.telemetry.select(dynamics.CHANNELS) for run in _runs(e)]
    sysid, noise = runs[0], runs[1] if e.noise else None
    rounded = [*rounding.roundings(sysid, noise), *(rounding.roundings(noise, sysid) if noise else ())]
    return _SampleReport(
        authority=[reason for run in runs for reason in authority.check_authority(run)],
        notes=[r.note for r in rounded if not (r.coarse or r.fine)],
        faults={
            "coarse_quantisation": [f"{r.said}; {rounding.CURE}" for r in rounded if r.coarse],
            "suspect_samples": list(samples.check_samples(sysid, noise)),
            "interpolated": list(samples.interpolated_channels(sysid)),
        },
    )


def _structural_break(e: Experiment) -> list[str]:
    """Return why the parts of a run obey different equations, if they do."""
    message = constancy.change(e)
    jumps = list(command_jumps(e.sysid.telemetry)) if message else []
    return jumps or [f"{e.sysid.telemetry.path}: {message}"] * bool(message)


def _first_reasons(exclusions: Sequence[Exclusion]) -> list[Exclusion]:
    """Return the first reason of each experiment."""
    reasons: dict[str, Exclusion] = {}
    for exclusion in exclusions:
        reasons.setdefault(exclusion.experiment, exclusion)
    return list(reasons.values())


def _faults_of_few(
    experiments: Sequence[Experiment], reasons: Mapping[str, list[str]], code: str
) -> ScreeningReport:
    """Exclude experiments with a fault, unless most have it: then only report it, for so they were made."""
    faulty = {name: texts for name, texts in reasons.items() if texts}
    if len(faulty) >= MIN_EXPERIMENTS and 2 * len(faulty) > len(experiments):
        texts = "; ".join(first for first, *_ in faulty.values())
        return ScreeningReport(
            [], [FitWarning(code, (), f"in most of the experiments something is odd: {texts}")]
        )
    return ScreeningReport([Exclusion(name, "; ".join(texts[:2])) for name, texts in faulty.items()], [])


def _runs(e: Experiment) -> list[Run]:
    return [e.sysid, e.noise] if e.noise else [e.sysid]


def _gap(a: Telemetry, b: Telemetry) -> float:
    """Return the time from the end of the earlier of two runs to the start of the other [s]."""
    a, b = sorted((a, b), key=lambda t: utc(t.t0))
    return (utc(b.t0) - utc(a.t0) - timedelta(seconds=a.duration)).total_seconds()


def _settings_mismatches(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments whose noise run has another authority or alignment."""
    for e in experiments:
        if e.noise is None:
            continue
        noise, sysid = e.noise.telemetry, e.sysid.telemetry
        for key in SETTINGS:
            here, there = getattr(noise, key), getattr(sysid, key)
            if not math.isclose(here, there, rel_tol=1e-6):
                reason = (
                    f"{noise.path}: attribute {key}: {here:g}, expected {there:g} as in {sysid.path}, "
                    "whose noise run it is"
                )
                yield Exclusion(e.name, reason)
                break


def _distant_noise_runs(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments whose noise run is far away, where most are adjacent."""
    gaps = {e.name: _gap(e.noise.telemetry, e.sysid.telemetry) for e in experiments if e.noise}
    if 2 * sum(gap < ADJACENT for gap in gaps.values()) <= len(gaps):
        return
    for e in experiments:
        if e.noise and gaps[e.name] > MAX_GAP:
            noise, sysid = e.noise.telemetry, e.sysid.telemetry
            yield Exclusion(
                e.name,
                f"{noise.path}: attribute t0: {noise.t0}, {gaps[e.name] / 86400:.0f} d away from "
                f"{sysid.path}, whose noise run it is; expected it next to that, as most are",
            )


def _duplicate_noise(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments that hold samples of another run, or of another of their own."""
    owners = [(e, run) for e in experiments for run in _runs(e)]
    both: dict[tuple[int, int], list[duplicates.Match]] = {}
    for match in duplicates.matches([run for _, run in owners]):
        both.setdefault((match.first, match.second), []).append(match)
    out: set[str] = set()
    for (first, second), found in sorted(both.items()):
        (e, a), (other, b) = owners[first], owners[second]
        if e.name in out or other.name in out:
            continue
        reason = _duplicate_text(a.telemetry, b.telemetry, found)
        for name in _mislabelled_owners(e, a, other, b, whole=len(found) == 2):
            out.add(name)
            yield Exclusion(name, reason)


def _duplicate_text(a: Telemetry, b: Telemetry, found: Sequence[duplicates.Match]) -> str:
    match = found[0]
    late = f", {abs(match.lag):g} s {'later' if match.lag > 0 else 'earlier'}" * (abs(match.lag) > 0.5)
    scaled = f", times {match.gain:.4g}" * (abs(match.gain - 1) > 1e-3)
    what = " and ".join(m.channel for m in found)
    return (
        f"{b.path}: {what} hold{'s' * (len(found) == 1)} the same noise as {a.path}{late}{scaled}: "
        f"{b.run} and {a.run} cannot be two runs"
    )


def _mislabelled_owners(e: Experiment, a: Run, other: Experiment, b: Run, *, whole: bool) -> list[str]:
    """Return the experiments to leave out for two runs that share their noise.

    Which of two that say different things is right, nobody knows: then both go.
    """
    kinds = a.telemetry.kind, b.telemetry.kind
    if e is other:
        return [e.name]
    if kinds[0] != kinds[1]:  # noise that is somebody's experiment, or an experiment that is noise
        sysid, noise = (e, other) if kinds[0] == "sysid" else (other, e)
        is_sysid = sysid.noise is None or _injected_readout(sysid.sysid.channels, sysid.noise.channels)
        return [noise.name if is_sysid else sysid.name]
    if whole and all(getattr(a.telemetry, key) == getattr(b.telemetry, key) for key in SETTINGS):
        return [other.name]
    return [e.name, other.name]


def _injected_channel(noise: Sequence[Run], run: Telemetry) -> str:
    """Return the channel of a run that shows injections, by itself or beside noise runs; or nothing."""
    taps, factor = derivatives.low_pass(run.fs)
    for name in (name for name in ("guidance_o_1", "guidance_o_12") if name in run.channels):
        x = derivatives.preprocess(run.channels[name], run.fs, taps, factor)[0]
        if np.ptp(x) > 0 and _spectral_lines(x, run.fs / factor)[2].any():
            return name
    own = dynamics.channels(run, motion=False)
    near = sorted(noise, key=lambda other: _gap(run, other.telemetry))[
        :MIN_EXPERIMENTS
    ]  # one may be no noise either
    found = [name for other in near if (name := _injected_readout(own, other.channels))]
    return found[0] if 2 * len(found) > len(near) else ""


def _injected_readout(run: dynamics.Channels, other: dynamics.Channels) -> str:
    """Return the read-out in which a run is louder than another as only injections make it, or nothing."""
    for name in ("o_1", "o_12"):
        f, power, lines = _spectral_lines(getattr(run, name), run.fs)
        if not lines.any():
            continue
        reference = np.interp(f, *_curvature_psd(getattr(other, name), other.fs))
        if np.all(reference > 0) and np.any(lines & (power > INJECTION_RATIO * reference)):
            return name
    return ""


def _spectral_lines(x: Array, fs: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return frequencies [Hz] up to `MAX_INJECTION`, the PSD there, and whether it is that of a sine."""
    f, power = _curvature_psd(x, fs)
    inside = (f > 2 / SEGMENT) & (f < MAX_INJECTION)
    level = scipy.ndimage.median_filter(power, MEDIAN_BINS, mode="nearest")
    # a run without noise is beside any other one of these
    return f[inside], power[inside], np.asarray((power > LINE_RATIO * level)[inside])


def _curvature_psd(x: Array, fs: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and the averaged PSD of the second differences of a series."""
    curvature = np.diff(x, 2)
    f, power = scipy.signal.welch(curvature, fs, nperseg=min(curvature.size, int(SEGMENT * fs)))
    return np.asarray(f), np.asarray(power)


def _noise_runs_with_injections(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments whose noise run holds injections."""
    for e in experiments:
        name = _injected_readout(e.noise.channels, e.sysid.channels) if e.noise else ""
        if e.noise and name:
            path = e.noise.telemetry.path
            reason = f"{path}: a noise run, but {name} holds injections, expected noise alone"
            yield Exclusion(e.name, reason, tells="cause")  # and no noise to hold the run against
