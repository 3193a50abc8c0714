"""What of a campaign file is special to LISA Pathfinder: truth, control, authorities, periods."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from lpfcosim.campaign.resolved_experiments import ConflictError, ResolvedExperiment
from lpfcosim.campaign.schema import CampaignTable, CommonTables
from lpfcosim.spacecraft import (
    DRAG_FREE,
    LARGEST_PULL,
    LONGEST_DELAY,
    M_TM,
    SUSPENSION,
    Authority,
    H,
    Injection,
    Noise,
    Sine,
    Truth,
    largest_pull,
)


def campaign_fields(table: CampaignTable) -> dict[str, Any]:
    """Return the fields of the `Campaign` that a file of LISA Pathfinder gives.

    Raises
    ------
    ConflictError
        If a delay is too short or too long.
    """
    return {
        "truth": _truth(table),
        "parameters": table.truth.declared,
        "drag_free": table.control.drag_free.onto(DRAG_FREE),
        "suspension": table.control.suspension.onto(SUSPENSION),
        "actuation": table.actuation.record(),
        "design": table.design,
        "identify": table.identify,
    }


def _truth(table: CampaignTable) -> Truth:
    values = table.truth.model_dump(exclude_unset=True, exclude=set(table.truth.declared))
    epochs = {int(key.removeprefix("delta_ifo_")): values.pop(key) for key in list(values) if "ifo" in key}
    truth = Truth(**values, delta_ifo={**Truth().delta_ifo, **epochs})
    for j, delay in ((1, truth.C_1 / truth.lambda_1), (2, truth.C_2 / truth.lambda_2)):
        if delay < H / 2:
            raise ConflictError(
                f"truth.C_{j}: C_{j}/lambda_{j} = {delay:.4g} s is below {H / 2:g} s, the half sample "
                "that the hold of a command already takes of its effective delay"
            )
        if delay > LONGEST_DELAY:
            raise ConflictError(
                f"truth.C_{j}: C_{j}/lambda_{j} = {delay:.4g} s is above {LONGEST_DELAY:g} s, too long for "
                "the delay of a command"
            )
    return truth


def check_epoch(place: ResolvedExperiment, truth: Truth) -> None:
    """Refuse an alignment epoch that the truth does not have."""
    k = place.table.alignment_epoch
    if k not in truth.delta_ifo:
        known = ", ".join(str(k) for k in sorted(truth.delta_ifo))
        raise ConflictError(
            f"{place.place_of('alignment_epoch')}: there is no truth.delta_ifo_{k} (known epochs: {known})"
        )


def spacecraft_of_experiment(table: CampaignTable, place: ResolvedExperiment, noise: Noise) -> object:
    """Return what the runs of an experiment have in addition to the x axis.

    Raises
    ------
    ConflictError
        If the experiment says what only the whole spacecraft has, or names a period that there is not.
    """
    craft, attitude = table.spacecraft, table.control.attitude
    if craft is None:
        if attitude:
            raise ConflictError("control.attitude: the x axis alone has no attitude, it takes [spacecraft]")
        return None
    period = place.table.inertial_period
    if period is not None and str(period) not in craft.period:
        known = ", ".join(craft.period) or "none"
        raise ConflictError(
            f"{place.place_of('inertial_period')}: there is no spacecraft.period.{period} (known periods: "
            f"{known})"
        )
    if craft.thruster_layout and noise.thruster_torque:
        is_own = "thruster_torque" in place.table.noise.model_fields_set
        raise ConflictError(
            f"{place.place_of('noise') if is_own else 'noise'}.thruster_torque: spacecraft.thruster_layout "
            'makes the noise of the torques, write "0 N m Hz^-0.5"'
        )
    equipment = craft.equipment(period)
    return replace(equipment, attitude=attitude.onto(equipment.attitude)) if attitude else equipment


def check_electrodes(table: CommonTables, entries: Sequence[ResolvedExperiment]) -> None:
    """Refuse authorities that together ask more of an electrode than it can give."""
    named = [(f"authority.{name}", a) for name, a in table.authority.items()]
    swept = [(entry.place_of("authority"), entry.authority) for entry in entries]
    for place, a in (*named, *swept):
        for j, limits in ((1, a and (a.F_max_1, a.N_max_1)), (2, a and (a.F_max_2, a.N_max_2))):
            if limits and largest_pull(*limits) > LARGEST_PULL:
                raise ConflictError(
                    f"{place}: F_max_{j} and N_max_{j} together ask {_pN(largest_pull(*limits))} of an "
                    f"electrode, expected at most {_pN(LARGEST_PULL)}, what it can give"
                )


def check_forces(
    placed: Sequence[tuple[str, Injection]],
    entry: ResolvedExperiment,
    authority: Authority,
    truth: Truth,
) -> None:
    """Refuse a force, with whatever acts at the same time, that the authority would clip."""
    holding = abs(entry.table.dc) * M_TM / truth.lambda_2
    if holding >= authority.F_max_2:
        raise ConflictError(
            f"{entry.place_of('dc')}: compensating it takes {_pN(holding)} of the {_pN(authority.F_max_2)} "
            f'that authority set "{authority.name}" gives to test mass 2; nothing remains for control'
        )
    for j, offset, F_max in ((1, 0.0, authority.F_max_1), (2, holding, authority.F_max_2)):
        forces = [(place, s) for place, s in placed if s.into == f"F_x_{j}"]
        for place, latest in forces:
            total = offset + sum(
                s.amplitude for _, s in forces if s.start <= latest.start and not _over(s, latest.start)
            )
            if total > F_max:
                also = "" if total == latest.amplitude else " with what acts at the same time"
                raise ConflictError(
                    f"{place}.amplitude: the force on test mass {j} reaches {_pN(total)}{also}, "
                    f'authority set "{authority.name}" allows {_pN(F_max)}'
                )


def _over(injection: Injection, time: float) -> bool:
    return isinstance(injection, Sine) and injection.end <= time


def _pN(force: float) -> str:
    return f"{force * 1e12:.4g} pN"
