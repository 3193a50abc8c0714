"""Tones that calibrate the tilt-to-length coupling of three LISA spacecraft in the least time.

Theta and eta of a spacecraft determine the coefficients of eta of its two assemblies, phi and the opening
those of phi. Every set point has one sine of the largest amplitude allowed, since several sines within the
same peak have less power. What remains is the frequency of each, an assignment that is improved by exchange.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.tilt_to_length import (
    NAMES,
    Measurements,
    expected_covariance,
    filter_duration,
    michelson,
    tone_information,
    usable_frequencies,
)
from lpfcosim.campaign import Campaign, Experiment
from lpfcosim.constellation import ASSEMBLIES, LEAD, TAIL, assembly_angles, spacecraft_motion
from lpfcosim.errors import InputError
from lpfcosim.experiment_design.manoeuvre_runs import (
    LONGEST,
    MOTIONS,
    check_runs,
    half_openings,
    motion_limits,
)
from lpfcosim.experiment_design.schedule import HOUR
from lpfcosim.linear import response
from lpfcosim.spacecraft import FS, Run, TaperedSine

Array = NDArray[np.float64]

PAIRS = (("guidance_theta", "guidance_eta"), ("guidance_phi", "guidance_opening"))
LINK_DELAY = 2.5e9 / michelson.C  # s, of an arm of 2.5 Gm
SPACING = 1e-3  # Hz, of two tones at least: one part in a manoeuvre of 1000 s
PAIR_SPACING = 3e-3  # Hz, of two tones that move the same assemblies, so that they add information alone
HIGHEST = 0.06  # Hz, of a tone; torques grow with the square of it (choice)
RATE = 5.0  # Hz, of simulated motion
SHORTEST = 300.0  # s, of what is left
START, RAMP = 150.0, 100.0  # s, of the tones; they are steady when the measurements begin
ROUND = 10.0  # s, to which the duration is rounded
ITERATIONS = 8  # of the duration
MARGIN = 1.01  # by which it grows beyond what a sigma calls for


@dataclass(frozen=True)
class ManoeuvreTone:
    """A tone of a design.

    Attributes
    ----------
    into : str
        Set point.
    frequency : float
        Hz.
    amplitude : float
        Of the set point [rad].
    motion : float
        Amplitude of the motion, the limit [rad].
    """

    into: str
    frequency: float
    amplitude: float
    motion: float


@dataclass(frozen=True)
class Manoeuvre:
    """A designed manoeuvre of three spacecraft.

    Attributes
    ----------
    plan, campaign : Campaign
        Before and after.
    tones : mapping of str to tuple of ManoeuvreTone
        By experiment.
    sigmas_before, sigmas_after, sigma_bounds : mapping of str to float
        Of the 24 coefficients [m/rad]; no design of these limits and the new duration is below the bounds.
    motion_limits, motion_reached : mapping of str to mapping of str to float
        Amplitudes by experiment and set point [rad].
    duration, duration_before, min_duration : float
        Of the runs of the design, of the tones of before for the same sigma, and the bound [s].
    """

    plan: Campaign
    campaign: Campaign
    tones: Mapping[str, tuple[ManoeuvreTone, ...]]
    sigmas_before: dict[str, float]
    sigmas_after: dict[str, float]
    sigma_bounds: dict[str, float]
    motion_limits: Mapping[str, Mapping[str, float]]
    motion_reached: Mapping[str, Mapping[str, float]]
    duration: float
    duration_before: float
    min_duration: float


@dataclass(frozen=True)
class _Candidates:
    """Information of the tones of one spacecraft on its eight coefficients, at all candidate frequencies.

    Attributes
    ----------
    experiment : str
        Its name.
    gains : dict of str to ndarray, shape (F,)
        Motion per set point, magnitudes.
    limits : dict of str to float
        Of the motion [rad].
    information : dict of str to ndarray, shape (F, 24, 24)
        By set point, of a second at the limit.
    """

    experiment: str
    gains: dict[str, Array]
    limits: dict[str, float]
    information: dict[str, Array]


def design_manoeuvre(plan: Campaign, target: float) -> Manoeuvre:
    """Find the tones and the duration with which no sigma exceeds a target.

    Parameters
    ----------
    plan : Campaign
        Three experiments, spacecraft 1, 2 and 3, each with a sine into every set point of `MOTIONS`. The
        largest amplitude into a set point is the limit of the motion.
    target : float
        Sigma of every coefficient [m/rad].

    Raises
    ------
    InputError
        If the campaign is none of three spacecraft with such tones, or the manoeuvre would take too long.
    """
    runs = [run for run in plan.runs if run.kind == "sysid"]
    check_runs(runs)
    openings = half_openings(runs)
    limits = motion_limits(runs)
    delays = _delays()
    f = usable_frequencies(np.arange(SPACING, HIGHEST, SPACING), delays)
    candidates = [
        _candidates(run, sc, f, delays, limits[run.experiment], openings)
        for run, sc in zip(runs, ASSEMBLIES, strict=True)
    ]
    variance = 1 / sum(  # [m^2 s rad^-2], each with the others known, at its best frequency
        np.diagonal(x, axis1=1, axis2=2).max(axis=0) for c in candidates for x in c.information.values()
    )
    overhead = LEAD + TAIL + filter_duration(RATE, delays)
    used = float(variance.max()) / target**2
    _check_duration(overhead + used, target)
    assignment = _assign(candidates, f)
    tones = {
        c.experiment: tuple(
            ManoeuvreTone(into, float(f[k]), float(c.limits[into] / c.gains[into][k]), c.limits[into])
            for into, k in assignment[i].items()
        )
        for i, c in enumerate(candidates)
    }
    before = _sigmas(_motions(plan), openings)
    duration = _rounded(overhead + max(used, SHORTEST))
    duration, campaign, motions, after = _shortest(plan, tones, target, (duration, overhead), openings)
    bounds = np.sqrt(variance / (duration - overhead))
    return Manoeuvre(
        plan,
        campaign,
        tones,
        before,
        after,
        dict(zip(NAMES, bounds.tolist(), strict=True)),
        limits,
        {run.experiment: _amplitudes(motion) for run, motion in zip(runs, motions, strict=True)},
        duration,
        overhead + (runs[0].n_samples / FS - overhead) * (max(before.values()) / target) ** 2,
        overhead + used,
    )


def _shortest(
    plan: Campaign,
    tones: Mapping[str, Sequence[ManoeuvreTone]],
    target: float,
    durations: tuple[float, float],
    openings: Mapping[str, float],
) -> tuple[float, Campaign, list[dict[str, Array]], dict[str, float]]:
    """Return duration [s], campaign, motions and sigmas of the tones once they reach the target.

    Durations are that of the first attempt and, of it, what the fit does not use [s].
    """
    duration, overhead = durations
    for _ in range(ITERATIONS):
        campaign = _with_tones(plan, tones, duration)
        motions = _motions(campaign)
        after = _sigmas(motions, openings)
        excess = (max(after.values()) / target) ** 2
        if excess <= 1:
            return duration, campaign, motions, after
        duration = _rounded(overhead + (duration - overhead) * MARGIN * excess)
        _check_duration(duration, target)
    raise InputError(
        f"sigma: {max(after.values()):.4g} m/rad after {ITERATIONS} attempts at the duration, expected "
        f"{target:g} m/rad; raise the amplitudes or sigma"
    )


def _rounded(duration: float) -> float:
    """Return the next round duration [s]."""
    return float(ROUND * np.ceil(duration / ROUND))


def _check_duration(duration: float, target: float) -> None:
    """Refuse a manoeuvre that would take too long [s], or for ever."""
    if not duration <= LONGEST:
        needed = f"takes {duration / HOUR:.3g} h" if duration < np.inf else "is out of reach"
        raise InputError(
            f"sigma: {target:g} m/rad {needed} with these amplitudes, expected {LONGEST / HOUR:g} h or less; "
            "raise the amplitudes or sigma"
        )


def _motions(plan: Campaign) -> list[dict[str, Array]]:
    """Return what the injections make of the channels of each spacecraft."""
    return [response.linear_response(run, rate=RATE) for run in plan.runs if run.kind == "sysid"]


def _sigmas(motions: Sequence[Mapping[str, Array]], openings: Mapping[str, float]) -> dict[str, float]:
    """Return the sigmas [m/rad] that three spacecraft with these motions are expected to give."""
    series: dict[str, Array] = {}
    for channels, sc in zip(motions, ASSEMBLIES, strict=True):
        series |= spacecraft_motion(channels, sc, openings[sc])
    lead, tail = round(LEAD * RATE), round(TAIL * RATE)
    angles = assembly_angles(series)
    rates = {name: np.gradient(x, 1 / RATE)[lead:-tail] for name, x in angles.items()}
    variables = dict.fromkeys(("X2", "Y2", "Z2"), np.zeros(next(iter(rates.values())).size))
    covariance = expected_covariance(Measurements(Path("plan"), RATE, variables, rates, _delays()))
    return dict(zip(NAMES, np.sqrt(np.diag(covariance)).tolist(), strict=True))


def _delays() -> dict[str, float]:
    """Return light travel times by link [s]."""
    return {link: LINK_DELAY for pair in ASSEMBLIES.values() for link in pair}


def _amplitudes(channels: Mapping[str, Array]) -> dict[str, float]:
    """Return the amplitude of a motion by set point [rad], transients included."""
    return {
        into: float(np.abs(sum(share * channels[name] for name, share in motion.items())).max())
        for into, motion in MOTIONS.items()
    }


def _candidates(
    run: Run,
    spacecraft: str,
    f: Array,
    delays: Mapping[str, float],
    limits: dict[str, float],
    openings: Mapping[str, float],
) -> _Candidates:
    """Return the information of the tones of one spacecraft."""
    system = response.recorded_system(run)
    channels = list(dict.fromkeys(name for motion in MOTIONS.values() for name in motion))
    transfer = system.select(list(MOTIONS), channels).frequency_response(f)
    at_rest = dict.fromkeys((*channels, "jitter_x_1", "jitter_x_2"), np.array(0.0))
    gains, information = {}, {}
    for i, (into, motion) in enumerate(MOTIONS.items()):
        share = np.array([motion.get(name, 0.0) for name in channels])
        gains[into] = np.abs(transfer[:, :, i] @ share)
        moving = {name: np.array(limits[into] * x / (share @ share)) for name, x in motion.items()}
        series: dict[str, Array] = {}
        for sc in ASSEMBLIES:
            series |= spacecraft_motion(at_rest | moving if sc == spacecraft else at_rest, sc, openings[sc])
        amplitudes = {name: float(x) for name, x in assembly_angles(series).items()}
        information[into] = tone_information(f, delays, amplitudes)
    return _Candidates(run.experiment, gains, limits, information)


def _assign(candidates: Sequence[_Candidates], f: Array) -> list[dict[str, int]]:
    """Return by spacecraft and set point the number of a frequency, all different.

    The largest variance of all coefficients is minimised, then their sum, by moving one tone or exchanging
    two as long as that helps.
    """
    blocks = [(i, pair) for i in range(len(candidates)) for pair in PAIRS]
    variances = [_pair_variances(candidates[i], pair, f) for i, pair in blocks]
    places: list[int] = []
    for variance in variances:  # each takes the best pair that is left
        free = variance.copy()
        free[places, :] = free[:, places] = np.inf
        places += [int(k) for k in np.unravel_index(free.argmin(), free.shape)]

    def value(places: Sequence[int]) -> tuple[float, float]:
        terms = [v[places[2 * b], places[2 * b + 1]] for b, v in enumerate(variances)]
        return float(max(terms)), float(sum(terms))

    best = value(places)
    improved = True
    while improved:
        improved = False
        for tone, k in product(range(len(places)), range(f.size)):
            trial = [places[tone] if place == k else place for place in places]
            trial[tone] = k
            if (score := value(trial)) < best:
                places, best, improved = trial, score, True
    return [
        {
            into: places[2 * b + side]
            for b, (i, pair) in enumerate(blocks)
            if i == number
            for side, into in enumerate(pair)
        }
        for number in range(len(candidates))
    ]


def _pair_variances(candidates: _Candidates, pair: tuple[str, str], f: Array) -> Array:
    """Return the largest variance of the coefficients that two tones move, shape (F, F) [m^2 s rad^-2]."""
    one, other = (candidates.information[into] for into in pair)
    moved = np.flatnonzero(np.diagonal(one[0] + other[0]) > 0)
    block = np.ix_(np.arange(len(one)), moved, moved)
    matrices = one[block][:, None] + other[block][None]
    scale = 1 / np.sqrt(np.diagonal(matrices, axis1=2, axis2=3))
    inverse = np.linalg.inv(matrices * scale[..., None] * scale[..., None, :])
    variance = (np.diagonal(inverse, axis1=2, axis2=3) * scale**2).max(axis=2)
    return np.where(np.abs(np.subtract.outer(f, f)) < PAIR_SPACING, np.inf, variance)


def _with_tones(plan: Campaign, tones: Mapping[str, Sequence[ManoeuvreTone]], duration: float) -> Campaign:
    """Return the campaign with other tones and another duration [s]."""

    def changed(experiment: Experiment) -> Experiment:
        sines = tuple(
            TaperedSine(
                tone.into,
                float(f"{tone.amplitude:.6g}"),
                tone.frequency,
                int((duration - START) * tone.frequency),
                START,
                ramp=RAMP,
            )
            for tone in tones[experiment.name]
        )
        return replace(experiment, n_samples=round(duration * FS), injections=sines)

    return replace(plan, experiments=tuple(changed(e) if e.n_samples else e for e in plan.experiments))
