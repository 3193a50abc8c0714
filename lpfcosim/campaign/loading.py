"""A campaign file, read and checked.

What one table can tell on its own is checked by its schema; here, what needs two of them. What is wrong with
a file is said in one sentence that gives the path inside it, such as
``quickstart.toml: experiments[2].injections[0].frequency: "6 Hz" is not below …``.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path

from pydantic import ValidationError

from fit.errors import quote
from fit.files import closest_match, validation_messages
from lpfcosim.campaign import sweep, toml_file
from lpfcosim.campaign.campaign import Campaign, Experiment, iso
from lpfcosim.campaign.injection_tables import SHAPES
from lpfcosim.campaign.resolved_experiments import (
    ConflictError,
    ResolvedExperiment,
    apply_defaults,
    check_defaults,
)
from lpfcosim.campaign.schema import CampaignTable, ExperimentTable, FmuTable
from lpfcosim.errors import InputError
from lpfcosim.linear import saturation, stability
from lpfcosim.models import model_of
from lpfcosim.network import Component
from lpfcosim.spacecraft import (
    DRAG_FREE,
    FS,
    LARGEST_PULL,
    LONGEST_DELAY,
    M_TM,
    SUSPENSION,
    Authority,
    H,
    Injection,
    Noise,
    Replacement,
    Sine,
    Truth,
    largest_pull,
)


def load(path: Path) -> Campaign:
    """Read a campaign file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or is not a campaign; one sentence with the path inside it.
    """
    raw = toml_file.load_extended(path)
    try:
        table = CampaignTable.model_validate(raw)
        if "extends" in raw:
            file_defaults = toml_file.load(path).get("defaults", {})
            check_defaults(file_defaults, table.experiments, swept=table.sweep is not None)
        campaign = _build(table)
    except ValidationError as error:
        raise InputError(f"{path}: {validation_messages(error, SHAPES)}") from None
    except ConflictError as error:
        raise InputError(f"{path}: {error}") from None
    return replace(campaign, tables={key: value for key, value in raw.items() if key != "extends"})


def sources(path: Path) -> tuple[Path, ...]:
    """Return a campaign file and those that it extends, one on top of the other; `load` must accept it."""
    content = toml_file.load(path)
    return (path, *(sources(path.parent / content["extends"]) if "extends" in content else ()))


def _shown(path: Path) -> str:
    """Return a path as it is, if that is for showing."""
    return str(path) if str(path).isprintable() and len(str(path)) < 500 else quote(str(path))


def _build(table: CampaignTable) -> Campaign:
    truth = _truth(table)
    entries = _entries(table)
    _check_electrodes(table, entries)
    experiments: list[Experiment] = []
    run_owners: dict[str, int] = {}
    for i, entry in enumerate(entries):
        experiment = _experiment(table, entry, truth)
        for name in experiment.run_names:
            owner = run_owners.setdefault(name.casefold(), i)
            if owner != i:
                raise ConflictError(
                    f'{entry.place_of("name")}: there would be two runs named "{name}", the other from '
                    f'{entries[owner].location} ("{experiments[owner].name}")'
                )
        experiments.append(experiment)
    campaign = Campaign(
        name=table.name,
        seed=table.seed,
        t0=iso(table.t0),
        truth=truth,
        drag_free=table.control.drag_free.onto(DRAG_FREE),
        suspension=table.control.suspension.onto(SUSPENSION),
        experiments=tuple(experiments),
        actuation=table.actuation.record(),
        events=table.events.record() if table.events else None,
        tail_scatter=table.events.tail_scatter if table.events else 0.0,
        fit=table.fit,
        design=table.design.record(),
        identify={name: entry.record() for name, entry in table.identify.items()},
    )
    _check_order(campaign, entries)
    if table.sweep and not table.fmus:
        _check_swept(campaign, entries)
    if not table.fmus:
        return campaign
    run = campaign.runs[0]
    spacecraft = model_of(run)
    places = {c.model: c for c in spacecraft.components(run)}
    for model in table.fmus:
        if model not in places:
            have = ", ".join(places)
            raise ConflictError(f"fmus.{model}: the loop of this campaign has no such place (it has {have})")
    parameters = spacecraft.parameters(run)
    return replace(
        campaign,
        replacements=tuple(
            _replacement(component, parameters[component.model], table.fmus[component.model])
            for component in places.values()
            if component.model in table.fmus
        ),
    )


def _entries(table: CampaignTable) -> tuple[ResolvedExperiment, ...]:
    """Return the experiments that are asked for: those written, or those of a sweep."""
    experiments = apply_defaults(table.experiments, table.defaults)
    if table.sweep is None:
        return experiments
    authority = table.authority.get(experiments[0].table.authority or "")
    return sweep.entries(experiments[0], table.sweep, authority, table.sequences)


def _check_order(campaign: Campaign, entries: Sequence[ResolvedExperiment]) -> None:
    """Refuse an experiment that would start before the one before it ends."""
    place = {
        name: entry for e, entry in zip(campaign.experiments, entries, strict=True) for name in e.run_names
    }
    for previous, run in pairwise(campaign.runs):
        end = datetime.fromisoformat(previous.t0) + timedelta(seconds=previous.n_samples / FS)
        if datetime.fromisoformat(run.t0) < end:
            raise ConflictError(
                f"{place[run.name].place_of('t0')}: {run.t0} is before {quote(previous.experiment)} ends, "
                f"at {iso(end)}"
            )


def _check_swept(campaign: Campaign, entries: Sequence[ResolvedExperiment]) -> None:
    """Refuse a run of a sweep whose injections alone ask for more than its authority gives."""
    for run in campaign.runs:
        if run.kind != "sysid" or not stability.is_stable(run):
            continue  # who simulates it is told of a loop that is not
        for demand in saturation.demands(run):
            if demand.channel not in saturation.READ_OUTS and demand.peak > demand.limit:
                (entry,) = (entry for entry in entries if entry.table.name == run.experiment)
                raise ConflictError(
                    f"{entry.location}: the injections of {quote(run.experiment)} take {demand.channel} to "
                    f"{100 * demand.peak / demand.limit:.3g} % of its authority; expected more authority or "
                    "less injected"
                )


def _replacement(component: Component, parameters: Collection[str], entry: FmuTable) -> Replacement:
    place = f"fmus.{component.model}"
    known = [*component.inputs, *component.outputs, *parameters]
    for name in entry.variables:
        if name not in known:
            raise ConflictError(f"{place}.variables: no variable {quote(name)}{closest_match(name, known)}")
    for k, name in enumerate(entry.unused):
        if name not in (*component.inputs, *parameters):
            choices = closest_match(name, [*component.inputs, *parameters])
            raise ConflictError(f"{place}.unused[{k}]: no input or parameter {quote(name)}{choices}")
        if name in entry.variables:
            raise ConflictError(f"{place}.unused[{k}]: {quote(name)} has a place under variables too")
    fed: dict[str, str] = {}
    for name in (*component.inputs, *(n for n in parameters if n in entry.variables)):
        fmu_variable = entry.variables.get(name, name)
        if name not in entry.unused and fed.setdefault(fmu_variable, name) != name:
            raise ConflictError(
                f"{place}.variables: {quote(fmu_variable)} stands for {fed[fmu_variable]} and for {name}"
            )
    for name in entry.values:
        if name in entry.variables.values() or (name in parameters and name not in entry.unused):
            raise ConflictError(f"{place}.values: {quote(name)} is set by the campaign already")
    archive = Path(entry.path)
    try:
        known_as = "no such file" if not archive.exists() else "" if archive.is_file() else "is not a file"
    except OSError as error:
        known_as = error.strerror or str(error)
    if known_as:
        raise ConflictError(f"{place}.path: {_shown(archive)}: {known_as}")
    return Replacement(
        component.model,
        archive,
        dict(entry.variables),
        tuple(entry.unused),
        dict(entry.values),
        entry.sha256,
        entry.validate_,
    )


def _check_electrodes(table: CampaignTable, entries: Sequence[ResolvedExperiment]) -> None:
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


def _truth(table: CampaignTable) -> Truth:
    values = table.truth.model_dump(exclude_unset=True)
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


def _experiment(table: CampaignTable, place: ResolvedExperiment, truth: Truth) -> Experiment:
    entry = place.table
    authority = _authority(table, place)
    if entry.alignment_epoch not in truth.delta_ifo:
        k = entry.alignment_epoch
        known = ", ".join(str(k) for k in sorted(truth.delta_ifo))
        raise ConflictError(
            f"{place.place_of('alignment_epoch')}: there is no truth.delta_ifo_{k} (known epochs: {known})"
        )
    if not entry.duration and not entry.noise_duration:
        raise ConflictError(
            f'{place.place_of("duration")}: missing, write duration = "6 h", or noise_duration alone'
        )
    noise = Noise(**{**table.noise.model_dump(), **entry.noise.model_dump(exclude_unset=True)})

    placed: list[tuple[str, Injection]] = []
    for k, name in enumerate(entry.sequences):
        if name not in table.sequences:
            known = closest_match(name, table.sequences)
            raise ConflictError(f"{place.place_of('sequences')}[{k}]: no sequence {quote(name)}{known}")
        placed += [
            (f"{place.prefix}sequences.{name}[{n}]", s.record()) for n, s in enumerate(table.sequences[name])
        ]
    placed += [(f"{place.place_of('injections')}[{n}]", s.record()) for n, s in enumerate(entry.injections)]
    for written_at, injection in placed:
        if injection.end > entry.duration + 1e-6:
            raise ConflictError(
                f'{written_at}: ends at {injection.end:.7g} s, past the end of experiment "{entry.name}" '
                f"at {entry.duration:.7g} s"
            )
    _check_forces(placed, place, authority, truth)
    return Experiment(
        name=entry.name,
        authority=authority,
        alignment_epoch=entry.alignment_epoch,
        n_samples=round(entry.duration * FS),
        n_noise_samples=round(entry.noise_duration * FS),
        dc=entry.dc,
        noise=noise,
        injections=tuple(injection for _, injection in placed),
        sample_rate=entry.sample_rate,
        inertial_period=entry.inertial_period or 0,
        t0=iso(entry.t0) if entry.t0 else None,
        plateau=_history(table, entry),
        spacecraft=_spacecraft(table, place, noise),
    )


def _history(table: CampaignTable, entry: ExperimentTable) -> tuple[tuple[str, float], ...]:
    """Return the plateau by date, which holds where an experiment has none of its own."""
    has_plateau = "plateau" in entry.noise.model_fields_set
    return () if table.events is None or has_plateau else table.events.levels()


def _authority(table: CampaignTable, place: ResolvedExperiment) -> Authority:
    name = place.table.authority
    if name is None:
        raise ConflictError(f'{place.place_of("authority")}: missing, write authority = "A"')
    if place.authority is None and name not in table.authority:
        known = closest_match(name, table.authority)
        raise ConflictError(f"{place.place_of('authority')}: no authority set {quote(name)}{known}")
    return Authority(name, **(place.authority or table.authority[name]).model_dump())


def _spacecraft(table: CampaignTable, place: ResolvedExperiment, noise: Noise) -> object:
    craft, attitude = table.spacecraft, table.control.attitude
    if craft is None:
        if attitude:
            raise ConflictError("control.attitude: the x axis alone has no attitude, it takes [spacecraft]")
        if place.table.temperature:
            raise ConflictError(
                f"{place.place_of('temperature')}: nothing of the x axis alone depends on it, it takes "
                "[spacecraft]"
            )
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
    equipment = craft.equipment(period, place.table.temperature)
    return replace(equipment, attitude=attitude.onto(equipment.attitude)) if attitude else equipment


def _check_forces(
    placed: Sequence[tuple[str, Injection]],
    entry: ResolvedExperiment,
    authority: Authority,
    truth: Truth,
) -> None:
    """Refuse a force, with whatever acts at the same time, that the authority would clip."""
    holding = abs(entry.table.dc) * M_TM / truth.lambda_2
    if holding >= authority.F_max_2:
        raise ConflictError(
            f"{entry.place_of('dc')}: holding it takes {_pN(holding)} of the {_pN(authority.F_max_2)} that "
            f'authority set "{authority.name}" gives to test mass 2, which leaves nothing to control with'
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
