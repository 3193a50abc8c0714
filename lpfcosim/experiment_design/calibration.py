"""Hours of the inertial calibration: as few as tell the angles of its periods as well as is wanted.

Tones tell nothing of these angles. The long noise runs of a period do: variances fall with their hours, down
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
from lpfcosim.experiment_design.timetable import HOUR, WHOLE, in_turn
from lpfcosim.spacecraft import FS

CLOSE, TRIES = 0.005, 6  # relative, below what is wanted, that is near enough; trials of hours
BEYOND = 20.0  # times the hours there are, the most that is tried


@dataclass(frozen=True)
class Angles:
    """What becomes of the inertial calibration.

    Attributes
    ----------
    wanted, before, after : mapping of str to float
        Sigmas by angle and period, such as ``delta_phi_1`` [rad].
    hours : tuple of float
        Of the noise runs of the periods concerned, before and after [s].
    """

    wanted: Sigmas
    before: Sigmas
    after: Sigmas
    hours: tuple[float, float]


def settled(plan: Campaign, wanted: Sigmas, inertial_model: InertialModel) -> tuple[Campaign, Angles]:
    """Return a campaign with the least hours of noise that tell angles as well as is wanted.

    Raises
    ------
    InputError
        If no hours do, or an experiment would reach into the next.
    """
    before = inertial_model.sigmas(plan)
    found, first, last = plan, 0.0, 0.0
    for period in sorted({_period(name) for name in wanted}):
        runs = [e for e in plan.experiments if _takes_part(e, period, euler_fit.MIN_DURATION)]
        of_period = {name: sigma for name, sigma in wanted.items() if _period(name) == period}
        if not runs:
            raise InputError(f"design.sigmas: {' and '.join(of_period)}: no run of noise alone tells of them")
        found = _shortened(found, runs, of_period, inertial_model)
        names = {e.name for e in runs}
        first += sum(e.n_noise_samples for e in runs) / FS
        last += sum(e.n_noise_samples for e in found.experiments if e.name in names) / FS
    return found, Angles(wanted, before, inertial_model.sigmas(found), (first, last))


def _period(name: str) -> str:
    return name.rsplit("_", 1)[1]


def _takes_part(experiment: Experiment, period: str, shortest: float) -> bool:
    """Tell whether it is noise alone, for the angles of a period."""
    long_enough = not experiment.n_samples and experiment.n_noise_samples / FS >= shortest
    return long_enough and str(experiment.inertial_period) == period


def _shortened(
    plan: Campaign, runs: Sequence[Experiment], wanted: Sigmas, inertial_model: InertialModel
) -> Campaign:
    """Return a campaign with the least hours of these runs."""

    def missed(factor: float) -> tuple[Campaign, float]:
        made = _lasting(plan, runs, factor, euler_fit.MIN_DURATION)
        told = inertial_model.sigmas(made)
        return made, max(told[name] / sigma for name, sigma in wanted.items()) ** 2

    factors, ratios = [1.0], [missed(1.0)[1]]
    best: Campaign | None = None
    for _ in range(TRIES):
        factor = _next(factors, ratios)
        made, ratio = missed(factor)
        best = made if ratio <= 1 else best
        factors.append(factor)
        ratios.append(ratio)
        short = not any(e.n_noise_samples > euler_fit.MIN_DURATION * FS for e in _of(made, runs))
        if (1 - CLOSE) ** 2 <= ratio <= 1 or (short and ratio <= 1) or factor == BEYOND:
            break
    if best is None:
        nearest, k = np.sqrt(min(ratios)), int(np.argmin(ratios))
        hours = sum(e.n_noise_samples for e in runs) / FS / HOUR * factors[k]
        raise InputError(
            f"design.sigmas: {' and '.join(wanted)}: beyond reach, with {hours:.0f} h of noise in the period "
            f"some sigma stays at {nearest:.3g} times what is wanted"
        )
    return best


def _next(factors: Sequence[float], ratios: Sequence[float]) -> float:
    """Return how much longer runs must be, if variances are a floor and a part that falls with the hours."""
    aim = (1 - CLOSE / 2) ** 2
    if len(factors) == 1:
        found = ratios[0] / aim
    else:
        (x, y), (u, v) = ((1 / f, r) for f, r in list(zip(factors, ratios, strict=True))[-2:])
        slope = (y - v) / (x - u) if x != u else 0.0
        floor = v - slope * u
        found = slope / (aim - floor) if slope > 0 and aim > floor else BEYOND
    return float(np.clip(found, 1e-3, BEYOND))


def _lasting(plan: Campaign, runs: Sequence[Experiment], factor: float, shortest: float) -> Campaign:
    """Return a campaign whose noise runs are longer or shorter; those for which no time is left are out."""
    total = factor * sum(e.n_noise_samples for e in runs) / FS
    kept = list(runs[: max(1, int(total // shortest))])
    whole = sum(e.n_noise_samples for e in kept) / FS
    lasts = {e.name: max(total * e.n_noise_samples / FS / whole, shortest) for e in kept}
    samples = {name: round(np.ceil(time / WHOLE) * WHOLE * FS) for name, time in lasts.items()}
    left_out = {e.name for e in runs} - samples.keys()
    experiments = tuple(
        replace(e, n_noise_samples=samples.get(e.name, e.n_noise_samples))
        for e in plan.experiments
        if e.name not in left_out
    )
    return in_turn(replace(plan, experiments=experiments))


def _of(plan: Campaign, runs: Sequence[Experiment]) -> list[Experiment]:
    names = {e.name for e in runs}
    return [e for e in plan.experiments if e.name in names]
