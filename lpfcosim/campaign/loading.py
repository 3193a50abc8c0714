"""A campaign file, read and checked.

What one table shows by itself is checked by its schema; here, what needs two of them. What is wrong with
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
from lpfcosim.campaign import lisa_pathfinder, other_spacecraft, sweep, toml_file
from lpfcosim.campaign.campaign import Campaign, Experiment, iso
from lpfcosim.campaign.injection_tables import SHAPES
from lpfcosim.campaign.other_spacecraft import OtherCampaignTable
from lpfcosim.campaign.resolved_experiments import (
    ConflictError,
    ResolvedExperiment,
    apply_defaults,
    check_defaults,
)
from lpfcosim.campaign.schema import CampaignTable, ExperimentTable, FmuTable
from lpfcosim.errors import InputError
from lpfcosim.linear import saturation, stability
from lpfcosim.models import SpacecraftModel, registered
from lpfcosim.network import Component
from lpfcosim.spacecraft import FS, Authority, Injection, Noise, Replacement, Spacecraft, Truth

AnyCampaignTable = CampaignTable | OtherCampaignTable


def load(path: Path) -> Campaign:
    """Read a campaign file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or is not a campaign; one sentence with the path inside it.
    """
    raw = toml_file.load_extended(path)
    try:
        spacecraft = _spacecraft_model(raw.get("spacecraft"))
        tables = OtherCampaignTable if isinstance(spacecraft.key, str) else CampaignTable
        table: AnyCampaignTable = tables.model_validate(raw, context=spacecraft)
        if "extends" in raw:
            file_defaults = toml_file.load(path).get("defaults", {})
            check_defaults(file_defaults, table.experiments, swept=table.sweep is not None)
        campaign = _build(table, spacecraft)
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


def _spacecraft_model(raw: object) -> SpacecraftModel:
    """Return the spacecraft model that a campaign file chooses by its key or table ``spacecraft``."""
    models = registered()
    if not isinstance(raw, str):
        return models[type(None) if raw is None else Spacecraft]
    if raw not in models:
        names = [name for name in models if isinstance(name, str)]
        raise ConflictError(f"spacecraft: no spacecraft {quote(raw)}{closest_match(raw, names)}")
    return models[raw]


def _build(table: AnyCampaignTable, spacecraft: SpacecraftModel) -> Campaign:
    if isinstance(table, OtherCampaignTable):
        fields = other_spacecraft.campaign_fields(table, spacecraft)
    else:
        fields = lisa_pathfinder.campaign_fields(table)
    entries = _entries(table)
    lisa_pathfinder.check_electrodes(table, entries)
    experiments: list[Experiment] = []
    run_owners: dict[str, int] = {}
    for i, entry in enumerate(entries):
        experiment = _experiment(table, entry, fields["truth"])
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
        experiments=tuple(experiments),
        events=table.events.record() if table.events else None,
        tail_scatter=table.events.tail_scatter if table.events else 0.0,
        fit=table.fit,
        **fields,
    )
    _check_order(campaign, entries)
    if table.sweep and not table.fmus:
        _check_swept(campaign, entries)
    if not table.fmus:
        return campaign
    run = campaign.runs[0]
    places = {c.model: c for c in spacecraft.components(run)}
    for model in table.fmus:
        if model not in places:
            match = closest_match(model, places)
            raise ConflictError(f"fmus.{model}: the loop of this campaign has no such place{match}")
    parameters = spacecraft.parameters(run)
    return replace(
        campaign,
        replacements=tuple(
            _replacement(component, parameters[component.model], table.fmus[component.model])
            for component in places.values()
            if component.model in table.fmus
        ),
    )


def _entries(table: AnyCampaignTable) -> tuple[ResolvedExperiment, ...]:
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
            continue  # an unstable loop is reported when it is simulated
        for demand in saturation.demands(run):
            if not demand.is_read_out and demand.peak > demand.limit:
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
        entry.step,
        entry.validate_,
    )


def _experiment(table: AnyCampaignTable, place: ResolvedExperiment, truth: Truth) -> Experiment:
    entry = place.table
    authority = _authority(table, place)
    if not entry.duration and not entry.noise_duration:
        raise ConflictError(
            f'{place.place_of("duration")}: missing, write duration = "6 h", or noise_duration alone'
        )
    noise = _noise(table, entry)

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
    lisa_pathfinder.check_forces(placed, place, authority, truth)
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
        spacecraft=_spacecraft(table, place, noise, truth),
    )


def _noise(table: AnyCampaignTable, entry: ExperimentTable) -> Noise:
    """Return the levels of noise of an experiment, its own before those of the campaign."""
    levels = {**table.noise.declared, **entry.noise.declared}
    fields = {**table.noise.model_dump(), **entry.noise.model_dump(exclude_unset=True)}
    return Noise(**{name: value for name, value in fields.items() if name not in levels}, levels=levels)


def _spacecraft(table: AnyCampaignTable, place: ResolvedExperiment, noise: Noise, truth: Truth) -> object:
    """Return what chooses the spacecraft model of the runs of an experiment."""
    if isinstance(table, OtherCampaignTable):
        other_spacecraft.check_experiment(table, place)
        return table.spacecraft
    lisa_pathfinder.check_epoch(place, truth)
    return lisa_pathfinder.spacecraft_of_experiment(table, place, noise)


def _history(table: AnyCampaignTable, entry: ExperimentTable) -> tuple[tuple[str, float], ...]:
    """Return the plateau by date, which holds where an experiment has none of its own."""
    has_plateau = "plateau" in entry.noise.model_fields_set
    return () if table.events is None or has_plateau else table.events.levels()


def _authority(table: AnyCampaignTable, place: ResolvedExperiment) -> Authority:
    name = place.table.authority
    if name is None:
        raise ConflictError(f'{place.place_of("authority")}: missing, write authority = "A"')
    if place.authority is None and name not in table.authority:
        known = closest_match(name, table.authority)
        raise ConflictError(f"{place.place_of('authority')}: no authority set {quote(name)}{known}")
    return Authority(name, **(place.authority or table.authority[name]).model_dump())
