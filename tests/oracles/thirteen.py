"""The calibration campaign of thirteen experiments and their noise runs, made by `closed_loop`.

Settings of authority, alignment epochs, noise and injections are those of the campaign that tells all
parameters apart; every run is drawn from its own seed and can be made, or made wrong, by itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

import numpy as np

from fit.telemetry.reader import Telemetry
from tests.oracles import closed_loop, synthetic
from tests.oracles.closed_loop import MASS, Drive, Hidden, Noise, Plant

#: F_max_1, F_max_2 [pN], N_max_1, N_max_2 [pN m].
AUTHORITIES = {
    **synthetic.AUTHORITIES,
    "F": (1100.0, 2200.0, 1.5, 1.0),
    "G": (4400.0, 5000.0, 1.5, 10.4),
}
TRUTH: Mapping[str, float] = {
    "lambda_1": 1.0748,
    "lambda_2": 1.0776,
    "C_1": 0.149,
    "C_2": 0.186,
    "omega2_1_0": -3.99e-7,
    "omega2_2_0": -4.19e-7,
    "alpha_x_1": -345.0,
    "alpha_phi_1": -28.2e3,
    "alpha_x_2": -317.0,
    "alpha_phi_2": -27.4e3,
    "delta_ifo_1": -2.2e-5,
    "delta_ifo_2": -1.40e-5,
    "delta_ifo_3": -2.09e-5,
    "delta_ifo_4": 1.91e-5,
}
UNITS = dict.fromkeys(("o_1", "o_12", "guidance_o_1", "guidance_o_12"), "m")
UNITS |= dict.fromkeys(("f_x_1", "f_x_2"), "m s-2")
NOISE_RUN = 28800.0  # s
GAP = 600.0  # s between a noise run and its experiment


@dataclass(frozen=True)
class Plan:
    """One experiment: its authority, epoch, noise, first day, and what it is for."""

    name: str
    epoch: int
    plateau: float  # fm s^-2 Hz^-1/2
    tail: float
    day: str
    purpose: str = "standard"

    @property
    def authority(self) -> tuple[float, float, float, float]:
        """F_max_1, F_max_2 [N], N_max_1, N_max_2 [N m]."""
        F_1, F_2, N_1, N_2 = (1e-12 * value for value in AUTHORITIES[self.name[0]])
        return F_1, F_2, N_1, N_2


PLANS = {
    plan.name: plan
    for plan in (
        Plan("A1", 1, 5.6, 1.5, "2016-03-14"),
        Plan("A1b", 1, 5.6, 1.5, "2016-03-29"),
        Plan("B2", 2, 5.0, 1.4, "2016-04-19"),
        Plan("C2", 2, 4.0, 1.3, "2016-05-10"),
        Plan("A2", 2, 4.0, 1.3, "2016-05-17"),
        Plan("D2", 2, 3.0, 1.2, "2016-06-02"),
        Plan("E3", 3, 3.0, 1.2, "2016-07-12"),
        Plan("F3", 3, 2.5, 1.1, "2016-09-08"),
        Plan("G3", 3, 2.5, 1.1, "2016-11-15", "test mass 1"),
        Plan("D3", 3, 2.2, 1.0, "2017-01-10", "tone"),
        Plan("B4", 4, 2.0, 1.0, "2017-02-21"),
        Plan("D4", 4, 1.9, 1.0, "2017-04-04"),
        Plan("C4", 4, 1.74, 1.0, "2017-05-16"),
    )
}


def _sequence(
    start: float, *tones: tuple[float, float, int]
) -> tuple[tuple[float, float, float, float], ...]:
    """Return sines of whole cycles, each (mHz, nm, cycles), a minute apart."""
    found = []
    for f, amplitude, cycles in tones:
        found.append((start, 1e-3 * f, 1e-9 * amplitude, cycles))
        start += cycles / (1e-3 * f) + 60
    return tuple(found)


_SUSPENSION = ((0.833, 10, 4), (1.667, 10, 4), (3.333, 10, 5), (13.33, 5, 12), (53.33, 0.7, 24))
_DRAG_FREE = ((0.833, 10, 4), (1.667, 10, 3), (6.67, 5, 8), (26.7, 4, 24), (53.3, 0.7, 32))
DRIVES = {
    "standard": Drive(_sequence(12000, *_DRAG_FREE), _sequence(900, *_SUSPENSION)),
    "test mass 1": Drive(
        _sequence(12000, *_DRAG_FREE),
        _sequence(900, *_SUSPENSION[:3]),
        tuple((1200.0, f, 0.6e-12 / MASS, cycles) for f, cycles in ((5e-3, 20), (10e-3, 40), (20e-3, 80))),
        (9000.0, 18000.0, 4e-9 / MASS),
    ),
    "tone": Drive(guidance_12=((1800.0, 1 / 300, 0.7e-9, 774),)),
}
DURATIONS = {"standard": 21600.0, "test mass 1": 21600.0, "tone": 65 * 3600.0}


def plant_of(plan: Plan, truth: Mapping[str, float]) -> Plant:
    """Return what one run has of the truth of the campaign."""
    F_1, F_2, N_1, N_2 = plan.authority
    return Plant(
        lambda_1=truth["lambda_1"],
        lambda_2=truth["lambda_2"],
        delay_1=truth["C_1"] / truth["lambda_1"],
        delay_2=truth["C_2"] / truth["lambda_2"],
        omega2_1=truth["omega2_1_0"] + truth["alpha_x_1"] * F_1 + truth["alpha_phi_1"] * N_1,
        omega2_2=truth["omega2_2_0"] + truth["alpha_x_2"] * F_2 + truth["alpha_phi_2"] * N_2,
        delta_ifo=truth[f"delta_ifo_{plan.epoch}"],
    )


@dataclass(frozen=True)
class Made:
    """How a run was made, for one who wants it made otherwise."""

    plan: Plan
    plant: Plant
    noise: Noise
    drive: Drive
    duration: float
    start: datetime
    seed: list[int]


def made(name: str, kind: str, seed: int = 0, truth: Mapping[str, float] = TRUTH) -> Made:
    """Return how the run of an experiment, ``sysid`` or ``noise``, is made."""
    plan = PLANS[name]
    at = list(PLANS).index(name)
    balance = np.random.default_rng([seed, at]).uniform(-1.2e-11, 1.2e-11)
    noise = Noise(1e-15 * plan.plateau, plan.tail, balance=float(balance))
    start = datetime.fromisoformat(plan.day) + timedelta(hours=8 + at % 5)
    if kind == "noise":
        begin = start - timedelta(seconds=NOISE_RUN + GAP)
        return Made(plan, plant_of(plan, truth), noise, Drive(), NOISE_RUN, begin, [seed, at, 1])
    drive, duration = DRIVES[plan.purpose], DURATIONS[plan.purpose]
    return Made(plan, plant_of(plan, truth), noise, drive, duration, start, [seed, at, 0])


def telemetry(how: Made, *, fs: float = 1.0, hidden: Hidden | None = None) -> Telemetry:
    """Make a run; its arrays are read-only, for others may hold them too."""
    channels = closed_loop.record(
        how.plant, how.noise, how.drive, how.duration, how.seed, fs=fs, hidden=hidden
    )
    kind = "noise" if how.drive == Drive() else "sysid"
    run = synthetic.recorded(
        AUTHORITIES[how.plan.name[0]],
        how.plan.name,
        kind,
        channels,
        fs=fs,
        t0=f"{how.start.isoformat()}Z",
        alignment_epoch=how.plan.epoch,
        units=dict(UNITS),
    )
    for values in (run.time, *channels.values()):
        values.flags.writeable = False
    return run


def campaign(
    seed: int = 0, truth: Mapping[str, float] = TRUTH, names: tuple[str, ...] = tuple(PLANS)
) -> dict[str, Telemetry]:
    """Return the runs of some experiments, all by default, by run name."""
    found = [telemetry(made(name, kind, seed, truth)) for name in names for kind in ("sysid", "noise")]
    return {run.run: replace(run, channels=dict(run.channels)) for run in found}
