"""Which experiments belong into one fit: what their files say of themselves, held against each other.

Nothing is fitted here. What contradicts itself stays out of the joint fit by name; where two runs are one,
the first stays, if both say the same of it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from itertools import chain, pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.model import dynamics
from fit.parallel import parallel_map
from fit.quality import authority, constancy, duplicates, rounding, samples
from fit.quality.channel_units import unit_faults
from fit.quality.exclusions import Exclusion
from fit.quality.loop_response import response_faults
from fit.spectra import derivatives
from fit.telemetry import Telemetry, utc
from fit.warnings import FitWarning
from fit.whitening import Experiment, Run

Array = NDArray[np.float64]

SETTINGS = ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch")
FAR = 30 * 86400.0  # s between a run and its noise run, where most are adjacent
ADJACENT = 86400.0  # s
ODD = (
    "coarse_quantisation",
    "suspect_samples",
    "interpolated",
)  # what is odd about samples, as warnings where it is so in most
USUAL = 3  # experiments; what more than half of so many have is no fault of one
INJECTED = 0.06  # Hz: up to here injections are looked for
SEGMENT = 2048.0  # s
SHARP, NEIGHBOURS = 12.0, 31  # power of a sine over the median of so many bins about it; noise has 6
DRIVEN = 300.0  # ratio of power in such a segment; noise that differs makes 25, an injected sine 1e4


@dataclass(frozen=True)
class Found:
    """What is wrong with experiments.

    Attributes
    ----------
    left_out : list of Exclusion
        Those that are no good, each once.
    notes : list of FitWarning
        What all of them have in common, so that there is nothing to leave out.
    """

    left_out: list[Exclusion]
    notes: list[FitWarning]


def faults(experiments: Sequence[Experiment]) -> Found:
    """Return the experiments that do not belong into one fit with the others, and what is odd about all."""
    units = parallel_map(lambda e: list(unit_faults(e)), experiments, Experiment.samples)
    found = [*_copied(experiments), *chain.from_iterable(units)]
    found += [*_other_settings(experiments), *_other_times(experiments)]
    names = [e.name for e in experiments]
    of_each = parallel_map(_of_own, experiments, Experiment.samples)
    beyond, rounded, *oddities = zip(*of_each, strict=True) if names else ((), (), (), (), ())
    found += [Exclusion(name, reason) for name, own in zip(names, beyond, strict=True) for reason in own]
    found += _noise_with_sines(experiments)
    reasons = {code: dict(zip(names, told, strict=True)) for code, told in zip(ODD, oddities, strict=True)}
    reasons["guidance_scale"] = {f.experiment: [f.reason] for f in response_faults(experiments)}
    odd = [_unless_usual(experiments, told, code) for code, told in reasons.items()]
    found += [fault for of in odd for fault in of.left_out]
    notes = [note for of in odd for note in of.notes]
    notes += [note for of_own in rounded for note in of_own]
    return Found(_first(found), [*notes, *_at_once(experiments)])


def mislabelled(experiments: Sequence[Experiment], telemetries: Sequence[Telemetry]) -> list[Exclusion]:
    """Return the noise runs of no experiment that hold injections: those of one, if the label were right."""
    names = {e.name for e in experiments}
    alone = [t for t in telemetries if t.kind == "noise" and t.experiment not in names]
    noise = [e.noise for e in experiments if e.noise]
    told = parallel_map(partial(_injected, noise), alone)
    return [
        Exclusion(
            run.experiment,
            f"{run.path}: attribute kind: 'noise', but {name} holds injections, expected 'sysid'",
            tells="cause",
        )
        for run, name in zip(alone, told, strict=True)
        if name
    ]


def changes(experiments: Sequence[Experiment]) -> Found:
    """Return the experiments, glitches masked, of which parts obey different equations."""
    changed = parallel_map(_changed, experiments, Experiment.samples)
    reasons = {e.name: told for e, told in zip(experiments, changed, strict=True)}
    found = _unless_usual(experiments, reasons, "structural_break")
    return replace(found, left_out=[replace(f, tells="misfit") for f in found.left_out])


def _of_own(e: Experiment) -> tuple[list[str], list[FitWarning], list[str], list[str], list[str]]:
    """Return what contradicts the authority of an experiment, notes on rounding, and what `ODD` has."""
    runs = [run.telemetry.select(dynamics.CHANNELS) for run in _runs(e)]
    sysid, noise = runs[0], runs[1] if e.noise else None
    beyond = [reason for run in runs for reason in authority.faults(run)]
    rounded = [*rounding.roundings(sysid, noise), *(rounding.roundings(noise, sysid) if noise else ())]
    coarse = [f"{r.said}; {rounding.CURE}" for r in rounded if r.coarse]
    notes = [r.note for r in rounded if not (r.coarse or r.fine)]
    return beyond, notes, coarse, list(samples.faults(sysid, noise)), list(samples.interpolated(sysid))


def _changed(e: Experiment) -> list[str]:
    """Return why the parts of a run obey different equations, if they do."""
    changed = constancy.change(e)
    jumping = list(samples.of_commands(e.sysid.telemetry)) if changed else []
    return jumping or [f"{e.sysid.telemetry.path}: {changed}"] * bool(changed)


def _first(found: Sequence[Exclusion]) -> list[Exclusion]:
    """Return the first reason of each experiment."""
    first: dict[str, Exclusion] = {}
    for fault in found:
        first.setdefault(fault.experiment, fault)
    return list(first.values())


def _unless_usual(experiments: Sequence[Experiment], reasons: Mapping[str, list[str]], code: str) -> Found:
    """Leave out what has a reason, unless most have: then it is how these were made, and only told."""
    struck = {name: told for name, told in reasons.items() if told}
    if len(struck) >= USUAL and 2 * len(struck) > len(experiments):
        told = "; ".join(first for first, *_ in struck.values())
        return Found([], [FitWarning(code, (), f"in most of the experiments something is odd: {told}")])
    return Found([Exclusion(name, "; ".join(told[:2])) for name, told in struck.items()], [])


def _at_once(experiments: Sequence[Experiment]) -> list[FitWarning]:
    """Return a note on runs that take place at once; it moves no estimate."""
    runs = sorted((r.telemetry for e in experiments for r in _runs(e)), key=lambda t: utc(t.t0))
    pairs = [(a, b) for a, b in pairwise(runs) if _gap(a, b) < -1.0]
    if not pairs or 2 * len(pairs) >= len(runs) - 1:
        return []  # where start times are made up, they tell nothing
    told = ", ".join(f"{a.run} and {b.run}" for a, b in pairs)
    return [FitWarning("same_time", (), f"t0 says that these took place at the same time: {told}")]


def _runs(e: Experiment) -> list[Run]:
    return [e.sysid, e.noise] if e.noise else [e.sysid]


def _gap(a: Telemetry, b: Telemetry) -> float:
    """Return the time from the end of the earlier of two runs to the start of the other [s]."""
    a, b = sorted((a, b), key=lambda t: utc(t.t0))
    return (utc(b.t0) - utc(a.t0) - timedelta(seconds=a.duration)).total_seconds()


def _other_settings(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
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


def _other_times(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments whose noise run is far away, where most are adjacent."""
    gaps = {e.name: _gap(e.noise.telemetry, e.sysid.telemetry) for e in experiments if e.noise}
    if 2 * sum(gap < ADJACENT for gap in gaps.values()) <= len(gaps):
        return
    for e in experiments:
        if e.noise and gaps[e.name] > FAR:
            noise, sysid = e.noise.telemetry, e.sysid.telemetry
            yield Exclusion(
                e.name,
                f"{noise.path}: attribute t0: {noise.t0}, {gaps[e.name] / 86400:.0f} d away from "
                f"{sysid.path}, whose noise run it is; expected it next to that, as most are",
            )


def _copied(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
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
        reason = _same(a.telemetry, b.telemetry, found)
        for name in _at_fault(e, a, other, b, whole=len(found) == 2):
            out.add(name)
            yield Exclusion(name, reason)


def _same(a: Telemetry, b: Telemetry, found: Sequence[duplicates.Match]) -> str:
    match = found[0]
    late = f", {abs(match.lag):g} s {'later' if match.lag > 0 else 'earlier'}" * (abs(match.lag) > 0.5)
    scaled = f", times {match.gain:.4g}" * (abs(match.gain - 1) > 1e-3)
    what = " and ".join(m.channel for m in found)
    return (
        f"{b.path}: {what} hold{'s' * (len(found) == 1)} the same noise as {a.path}{late}{scaled}: "
        f"{b.run} and {a.run} cannot be two runs"
    )


def _at_fault(e: Experiment, a: Run, other: Experiment, b: Run, *, whole: bool) -> list[str]:
    """Return the experiments to leave out for two runs that share their noise.

    Which of two that say different things is right, nobody knows: then both go.
    """
    kinds = a.telemetry.kind, b.telemetry.kind
    if e is other:
        return [e.name]
    if kinds[0] != kinds[1]:  # noise that is somebody's experiment, or an experiment that is noise
        sysid, noise = (e, other) if kinds[0] == "sysid" else (other, e)
        is_sysid = sysid.noise is None or _louder(sysid.sysid.channels, sysid.noise.channels)
        return [noise.name if is_sysid else sysid.name]
    if whole and all(getattr(a.telemetry, key) == getattr(b.telemetry, key) for key in SETTINGS):
        return [other.name]
    return [e.name, other.name]


def _injected(noise: Sequence[Run], run: Telemetry) -> str:
    """Return the channel of a run that shows injections, by itself or beside noise runs; or nothing."""
    taps, factor = derivatives.low_pass(run.fs)
    for name in (name for name in ("guidance_o_1", "guidance_o_12") if name in run.channels):
        x = derivatives.preprocess(run.row(name), run.fs, taps, factor)[0]
        if np.ptp(x) > 0 and _sines(x, run.fs / factor)[2].any():
            return name
    own = dynamics.channels(run, motion=False)
    near = sorted(noise, key=lambda other: _gap(run, other.telemetry))[:USUAL]  # one may be no noise either
    found = [name for other in near if (name := _louder(own, other.channels))]
    return found[0] if 2 * len(found) > len(near) else ""


def _louder(run: dynamics.Channels, other: dynamics.Channels) -> str:
    """Return the read-out in which a run is louder than another as only injections make it, or nothing."""
    for name in ("o_1", "o_12"):
        f, power, sines = _sines(getattr(run, name), run.fs)
        if not sines.any():
            continue
        least = np.interp(f, *_averaged(getattr(other, name), other.fs))
        if np.all(least > 0) and np.any(sines & (power > DRIVEN * least)):
            return name
    return ""


def _sines(x: Array, fs: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return frequencies [Hz] up to INJECTED, the averaged PSD there, and whether it is that of a sine."""
    f, power = _averaged(x, fs)
    inside = (f > 2 / SEGMENT) & (f < INJECTED)
    level = scipy.ndimage.median_filter(power, NEIGHBOURS, mode="nearest")
    # a run without noise is beside any other one of these
    return f[inside], power[inside], np.asarray((power > SHARP * level)[inside])


def _averaged(x: Array, fs: float) -> tuple[Array, Array]:
    """Return frequencies [Hz] and the averaged PSD of the second differences of a series."""
    curve = np.diff(x, 2)
    f, power = scipy.signal.welch(curve, fs, nperseg=min(curve.size, int(SEGMENT * fs)))
    return np.asarray(f), np.asarray(power)


def _noise_with_sines(experiments: Sequence[Experiment]) -> Iterator[Exclusion]:
    """Yield the experiments whose noise run holds injections."""
    for e in experiments:
        name = _louder(e.noise.channels, e.sysid.channels) if e.noise else ""
        if e.noise and name:
            path = e.noise.telemetry.path
            reason = f"{path}: a noise run, but {name} holds injections, expected noise alone"
            yield Exclusion(e.name, reason, tells="cause")  # and no noise to hold the run against
