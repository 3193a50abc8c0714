"""The consistency of telemetry with a campaign, by its attributes and its recorded guidance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import quote
from fit.files import closest_match
from fit.telemetry import TOWARDS_1, Telemetry, utc
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.models import stimuli
from lpfcosim.spacecraft import Authority, Run

Array = NDArray[np.float64]

GUIDANCE = ("guidance_o_1", "guidance_o_12")
_FMU = "fmu_"  # before the name of a component: the attribute with the digest of its FMU
AUTHORITY_TOLERANCE = 1e-6  # relative: an authority as archives round it
GUIDANCE_TOLERANCE = (
    0.1  # of the rms of a guidance: filters of archives, a clock that is some tenths of a second off
)


def check(plan: Campaign, telemetries: Sequence[Telemetry]) -> None:
    """Refuse telemetry of another campaign: other experiments, authority or injections.

    Noise runs without a sysid run are not checked, as nothing is identified from them.

    Raises
    ------
    InputError
        With file, place and what was expected.
    """
    for telemetry in _of_experiments(telemetries):
        try:
            run = run_of(plan, telemetry)
        except InputError as error:
            raise InputError(f"{telemetry.path}: {error}") from None
        planned_run = _planned_run(plan, telemetry)
        for name in ("F_max_1", "F_max_2", "N_max_1", "N_max_2"):
            has, expected = getattr(telemetry, name), getattr(planned_run.authority, name)
            if not math.isclose(has, expected, rel_tol=AUTHORITY_TOLERANCE):
                raise InputError(
                    f"{telemetry.path}: attribute {name}: {has:.7g}, expected {expected:.7g}, the authority "
                    f"of experiment {quote(run.experiment)} of the campaign"
                )
        for name in GUIDANCE:
            if name in telemetry.channels and not _has_planned_guidance(run, telemetry, name):
                raise InputError(
                    f"{telemetry.path}: channel {name}: differs from the injections of experiment "
                    f"{quote(run.experiment)} of the campaign; expected telemetry of this campaign, or a "
                    "campaign with the injections of this telemetry"
                )


def loop_mismatch(plan: Campaign, telemetries: Sequence[Telemetry], digests: Mapping[str, str]) -> str:
    """Return how the loop that simulated telemetry differs, by its attributes; empty if it does not.

    Parameters
    ----------
    plan : Campaign
        Names the runs.
    telemetries : sequence of Telemetry
        Those without attributes of a simulation, such as flown ones, are ignored.
    digests : mapping of str to str
        Of the FMU of each component of the loop.
    """
    other_models: dict[str, None] = {}
    rates: dict[str, None] = {}
    for telemetry in _of_experiments(telemetries):
        attributes = telemetry.attributes
        simulated = {key.removeprefix(_FMU): attributes[key] for key in attributes if key.startswith(_FMU)}
        if is_simulated(telemetry):
            expected = _planned_run(plan, telemetry).sample_rate
            if telemetry.fs != expected:
                rates[f"samples at {telemetry.fs:g} Hz, where the campaign has {expected:g} Hz"] = None
            models = (*digests, *sorted(simulated.keys() - digests.keys()))
            other_models |= dict.fromkeys(m for m in models if simulated.get(m) != digests.get(m))
    return "; ".join(
        [*rates, *([f"with other FMUs in the place of {', '.join(other_models)}"] if other_models else [])]
    )


def is_simulated(telemetry: Telemetry) -> bool:
    """Return whether telemetry has attributes of a simulation."""
    return any(key.startswith(_FMU) for key in telemetry.attributes)


def run_of(plan: Campaign, telemetry: Telemetry) -> Run:
    """Return the run of a campaign that a telemetry is of, as the telemetry has it.

    Raises
    ------
    InputError
        If the campaign has no such run.
    """
    (F_1, N_1), (F_2, N_2) = telemetry.authority
    run = _planned_run(plan, telemetry)
    return replace(
        run,
        truth=plan.truth,
        authority=Authority(run.authority.name, F_1, F_2, N_1, N_2),
        alignment_epoch=telemetry.alignment_epoch,
        m_tm=telemetry.m_tm,
    )


def start_sample(run: Run, telemetry: Telemetry) -> int:
    """Return at which sample of a run, at the rate of its loop, a telemetry begins."""
    since = (utc(telemetry.t0) - utc(run.t0)).total_seconds() + float(telemetry.time[0])
    return round(since * run.fs)


def size(run: Run, telemetry: Telemetry) -> int:
    """Return the number of samples of a telemetry at the rate of the loop."""
    return round(telemetry.size * run.fs / telemetry.fs)


def _planned_run(plan: Campaign, telemetry: Telemetry) -> Run:
    known = [run for run in plan.runs if run.kind == telemetry.kind]
    for run in known:
        if run.experiment == telemetry.experiment:
            return run
    names = [run.experiment for run in known]
    raise InputError(
        f"attribute experiment: {quote(telemetry.experiment)}, expected one of which the campaign has a "
        f"{telemetry.kind} run{closest_match(telemetry.experiment, names)}"
    )


def _of_experiments(telemetries: Sequence[Telemetry]) -> Iterator[Telemetry]:
    driven = {t.experiment for t in telemetries if t.kind == "sysid"}
    return (t for t in telemetries if t.experiment in driven)


def _has_planned_guidance(run: Run, telemetry: Telemetry, name: str) -> bool:
    """Return whether a recorded guidance is that of the campaign, at its time or from the start of the run.

    A campaign may leave out what is recorded; one that simulated the run itself cannot have.
    """
    x_sign = -1.0 if telemetry.x_axis == TOWARDS_1 else 1.0
    recorded = x_sign * telemetry.channels[name]
    is_finite = np.isfinite(recorded)
    offset, n = start_sample(run, telemetry), size(run, telemetry)
    simulated = "campaign_digest" in telemetry.attributes
    for start in (offset, 0) if simulated else (offset,):
        guidance = stimuli.injections(run, start, start + n)[name][:: round(run.fs / telemetry.fs)]
        loudest = max(_rms(guidance[is_finite]), _rms(recorded[is_finite]))
        if _rms((recorded - guidance)[is_finite]) <= GUIDANCE_TOLERANCE * loudest or not (
            simulated or guidance.any()
        ):
            return True
    return False


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else 0.0
