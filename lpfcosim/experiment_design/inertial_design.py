"""Noise runs of the inertial calibration, as short as the target sigmas of its angles allow.

Tones do not determine these angles. The long noise runs of a period do: variances fall with their hours, down
to what the joint fit leaves uncertain. All runs of a period get the same share of what they last; where they
would be too short to take part, those at its end are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fit.crosstalk import euler_fit
from lpfcosim.campaign import Campaign, Experiment
from lpfcosim.errors import InputError
from lpfcosim.experiment_design.fit_model import InertialModel, Sigmas
from lpfcosim.experiment_design.schedule import HOUR, TIME_STEP, check_schedule
from lpfcosim.spacecraft import FS

TOLERANCE, MAX_TRIALS = 0.005, 6  # relative, below what is wanted, that is near enough; trials of hours
MAX_FACTOR = 20.0  # times the hours there are, the most that is tried


@dataclass(frozen=True)
class InertialDesign:
    """The inertial calibration before and after the design.

    Attributes
    ----------
    target_sigmas, sigmas_before, sigmas_after : mapping of str to float
        Sigmas by angle and period, such as ``delta_phi_1`` [rad].
    durations : tuple of float
        Of the noise runs of the periods concerned, before and after [s].
    """

    target_sigmas: Sigmas
    sigmas_before: Sigmas
    sigmas_after: Sigmas
    durations: tuple[float, float]


def shorten_noise_runs(
    plan: Campaign, target_sigmas: Sigmas, inertial_model: InertialModel
) -> tuple[Campaign, InertialDesign]:
    """Return a campaign with the shortest noise runs that reach target sigmas of angles.

    Raises
    ------
    InputError
        If no hours do, or an experiment would reach into the next.
    """
    sigmas_before = inertial_model.sigmas(plan)
    campaign, time_before, time_after = plan, 0.0, 0.0
    for period in sorted({_period(name) for name in target_sigmas}):
        runs = [e for e in plan.experiments if _is_inertial(e, period, euler_fit.MIN_DURATION)]
        of_period = {name: sigma for name, sigma in target_sigmas.items() if _period(name) == period}
        if not runs:
            raise InputError(f"design.sigmas: {' and '.join(of_period)}: no noise run determines them")
        campaign = _shorten(campaign, runs, of_period, inertial_model)
        names = {e.name for e in runs}
        time_before += sum(e.n_noise_samples for e in runs) / FS
        time_after += sum(e.n_noise_samples for e in campaign.experiments if e.name in names) / FS
    return campaign, InertialDesign(
        target_sigmas, sigmas_before, inertial_model.sigmas(campaign), (time_before, time_after)
    )


def _period(name: str) -> str:
    return name.rsplit("_", 1)[1]


def _is_inertial(experiment: Experiment, period: str, min_durations: float) -> bool:
    """Return whether an experiment is a noise run that determines the angles of a period."""
    long_enough = not experiment.n_samples and experiment.n_noise_samples / FS >= min_durations
    return long_enough and str(experiment.inertial_period) == period


def _shorten(
    plan: Campaign, runs: Sequence[Experiment], target_sigmas: Sigmas, inertial_model: InertialModel
) -> Campaign:
    """Return a campaign with the least hours of these runs."""

    def variance_ratio(factor: float) -> tuple[Campaign, float]:
        variant = _with_noise_duration(plan, runs, factor, euler_fit.MIN_DURATION)
        sigmas = inertial_model.sigmas(variant)
        return variant, max(sigmas[name] / sigma for name, sigma in target_sigmas.items()) ** 2

    factors, ratios = [1.0], [variance_ratio(1.0)[1]]
    shortest_campaign: Campaign | None = None
    for _ in range(MAX_TRIALS):
        factor = _next_factor(factors, ratios)
        variant, ratio = variance_ratio(factor)
        shortest_campaign = variant if ratio <= 1 else shortest_campaign
        factors.append(factor)
        ratios.append(ratio)
        short = not any(
            e.n_noise_samples > euler_fit.MIN_DURATION * FS for e in _experiments_of(variant, runs)
        )
        if (1 - TOLERANCE) ** 2 <= ratio <= 1 or (short and ratio <= 1) or factor == MAX_FACTOR:
            break
    if shortest_campaign is None:
        nearest, k = np.sqrt(min(ratios)), int(np.argmin(ratios))
        hours = sum(e.n_noise_samples for e in runs) / FS / HOUR * factors[k]
        raise InputError(
            f"design.sigmas: {' and '.join(target_sigmas)}: beyond reach, with {hours:.0f} h of noise in "
            f"the period some sigma remains {nearest:.3g} times the goal"
        )
    return shortest_campaign


def _next_factor(factors: Sequence[float], ratios: Sequence[float]) -> float:
    """Return how much longer runs must be, if variances are a floor and a part that falls with the hours."""
    target = (1 - TOLERANCE / 2) ** 2
    if len(factors) == 1:
        factor = ratios[0] / target
    else:
        (x, y), (u, v) = ((1 / f, r) for f, r in list(zip(factors, ratios, strict=True))[-2:])
        slope = (y - v) / (x - u) if x != u else 0.0
        floor = v - slope * u
        factor = slope / (target - floor) if slope > 0 and target > floor else MAX_FACTOR
    return float(np.clip(factor, 1e-3, MAX_FACTOR))


def _with_noise_duration(
    plan: Campaign, runs: Sequence[Experiment], factor: float, min_durations: float
) -> Campaign:
    """Return a campaign whose noise runs are longer or shorter; those for which no time is left are out."""
    total = factor * sum(e.n_noise_samples for e in runs) / FS
    kept_runs = list(runs[: max(1, int(total // min_durations))])
    total_noise = sum(e.n_noise_samples for e in kept_runs) / FS
    durations = {e.name: max(total * e.n_noise_samples / FS / total_noise, min_durations) for e in kept_runs}
    samples = {name: round(np.ceil(time / TIME_STEP) * TIME_STEP * FS) for name, time in durations.items()}
    left_out = {e.name for e in runs} - samples.keys()
    experiments = tuple(
        replace(e, n_noise_samples=samples.get(e.name, e.n_noise_samples))
        for e in plan.experiments
        if e.name not in left_out
    )
    return check_schedule(replace(plan, experiments=experiments))


def _experiments_of(plan: Campaign, runs: Sequence[Experiment]) -> list[Experiment]:
    names = {e.name for e in runs}
    return [e for e in plan.experiments if e.name in names]
