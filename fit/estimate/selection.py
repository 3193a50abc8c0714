"""Which runs belong together, and which experiments take part in the joint fit."""

import math
from collections.abc import Sequence

from fit.errors import InputError
from fit.estimate.runs import Experiment, Run
from fit.settings import Settings
from fit.telemetry import Telemetry

JOINT_DURATION = 21600.0  # s: shorter runs hardly see the stiffness and take part only when asked to
SHORTEST = 1800.0  # s: below, the band holds too few bins for a noise PSD
TRIMMED = 0.005  # fraction a decimation may have cut from a run's ends


def experiments(telemetries: Sequence[Telemetry]) -> list[Experiment]:
    """Pair each sysid run with the noise run of the same experiment, where there is one.

    Raises
    ------
    InputError
        If a run and its noise run do not belong together, there are two of them, or one is too short.
    """
    _check_names(telemetries)
    return [_experiment(run, telemetries) for run in telemetries if run.kind == "sysid"]


def divide(
    found: Sequence[Experiment], chosen: Settings
) -> tuple[list[Experiment], list[Experiment], list[Experiment]]:
    """Return the experiments that take part in the joint fit, those too short for it, and those excluded.

    Raises
    ------
    InputError
        If an experiment that the settings exclude is not there.
    """
    names = [e.name for e in found]
    for name in chosen.exclude:
        if name not in names:
            raise InputError(f"fit.exclude: no experiment {name!r}, there are {', '.join(names)}")
    excluded = [e for e in found if e.name in chosen.exclude]
    short = [
        e
        for e in found
        if e.sysid.telemetry.duration < JOINT_DURATION * (1 - TRIMMED) and not chosen.include_short
    ]
    return [e for e in found if e not in (*excluded, *short)], short, excluded


def _check_names(telemetries: Sequence[Telemetry]) -> None:
    """Refuse two sysid runs of one experiment, and two noise runs of one that has a sysid run."""
    driven = {run.experiment for run in telemetries if run.kind == "sysid"}
    seen: dict[tuple[str, str], Telemetry] = {}
    for run in telemetries:
        twin = seen.setdefault((run.experiment, run.kind), run)
        if twin is not run and run.experiment in driven:
            raise InputError(
                f"{run.path}: a second {run.kind} run of experiment {run.experiment!r} beside {twin.path}, "
                "expected one"
            )


def _experiment(sysid: Telemetry, telemetries: Sequence[Telemetry]) -> Experiment:
    noise = next((t for t in telemetries if t.kind == "noise" and t.experiment == sysid.experiment), None)
    for run in (sysid, noise):
        if run is not None and run.duration < SHORTEST:
            raise InputError(f"{run.path}: lasts {run.duration:.6g} s, expected at least {SHORTEST:g} s")
    if noise is not None:
        for key in ("F_max_1", "F_max_2", "N_max_1", "N_max_2", "alignment_epoch"):
            here, there = getattr(noise, key), getattr(sysid, key)
            if not math.isclose(here, there, rel_tol=1e-6):
                raise InputError(
                    f"{noise.path}: attribute {key}: {here:g}, expected {there:g} as in {sysid.path}, "
                    "whose noise run it is"
                )
    return Experiment(Run(sysid), None if noise is None else Run(noise))
