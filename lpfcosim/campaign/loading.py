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
from fit.files import closest, told
from lpfcosim.campaign import file
from lpfcosim.campaign.campaign import Campaign, Experiment, iso
from lpfcosim.campaign.schema import (
    LONGEST_DELAY,
    SHAPES,
    CampaignTable,
    ExperimentTable,
    FmuTable,
    SpacecraftTable,
)
from lpfcosim.errors import InputError
from lpfcosim.network import Component
from lpfcosim.spacecraft import (
    DRAG_FREE,
    FS,
    M_TM,
    SUSPENSION,
    Authority,
    H,
    Injection,
    Noise,
    Replacement,
    Sine,
    Truth,
)
from lpfcosim.worlds import world_of


def load(path: Path) -> Campaign:
    """Read a campaign file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or is not a campaign; one sentence with the path inside it.
    """
    raw = file.read(path)
    try:
        found = _build(CampaignTable.model_validate(raw))
    except ValidationError as error:
        raise InputError(f"{path}: {told(error, SHAPES)}") from None
    except _ConflictError as error:
        raise InputError(f"{path}: {error}") from None
    return replace(found, tables={key: value for key, value in raw.items() if key != "extends"})


def _shown(path: Path) -> str:
    """Return a path as it is, if that is for showing."""
    return str(path) if str(path).isprintable() and len(str(path)) < 500 else quote(str(path))


class _ConflictError(Exception):
    """Two places of a campaign file that do not go together."""


def _build(table: CampaignTable) -> Campaign:
    truth = _truth(table)
    experiments: list[Experiment] = []
    taken: dict[str, int] = {}
    for i, entry in enumerate(table.experiments):
        experiment = _experiment(table, entry, f"experiments[{i}]", truth)
        for name in experiment.run_names:
            first = taken.setdefault(name.casefold(), i)
            if first != i:
                raise _ConflictError(
                    f'experiments[{i}].name: there would be two runs named "{name}", the other from '
                    f'experiments[{first}] ("{experiments[first].name}")'
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
        fit=table.fit,
    )
    _check_order(campaign)
    run = campaign.runs[0]
    world = world_of(run)
    places = {c.model: c for c in world.components}
    for model in table.fmus:
        if model not in places:
            have = ", ".join(places)
            raise _ConflictError(f"fmus.{model}: the loop of this campaign has no such place (it has {have})")
    parameters = world.parameters(run)
    return replace(
        campaign,
        replacements=tuple(
            _replacement(component, parameters[component.model], table.fmus[component.model])
            for component in places.values()
            if component.model in table.fmus
        ),
    )


def _check_order(campaign: Campaign) -> None:
    """Refuse an experiment that would start before the one before it ends."""
    place = {name: i for i, e in enumerate(campaign.experiments) for name in e.run_names}
    for before, run in pairwise(campaign.runs):
        end = datetime.fromisoformat(before.t0) + timedelta(seconds=before.n_samples / FS)
        if datetime.fromisoformat(run.t0) < end:
            raise _ConflictError(
                f"experiments[{place[run.name]}].t0: {run.t0} is before {quote(before.experiment)} ends, "
                f"at {iso(end)}"
            )


def _replacement(component: Component, parameters: Collection[str], entry: FmuTable) -> Replacement:
    where = f"fmus.{component.model}"
    known = [*component.inputs, *component.outputs, *parameters]
    for name in entry.variables:
        if name not in known:
            raise _ConflictError(f"{where}.variables: no variable {quote(name)}{closest(name, known)}")
    for k, name in enumerate(entry.unused):
        if name not in (*component.inputs, *parameters):
            choices = closest(name, [*component.inputs, *parameters])
            raise _ConflictError(f"{where}.unused[{k}]: no input or parameter {quote(name)}{choices}")
        if name in entry.variables:
            raise _ConflictError(f"{where}.unused[{k}]: {quote(name)} has a place under variables too")
    fed: dict[str, str] = {}
    for name in (*component.inputs, *(n for n in parameters if n in entry.variables)):
        theirs = entry.variables.get(name, name)
        if name not in entry.unused and fed.setdefault(theirs, name) != name:
            raise _ConflictError(
                f"{where}.variables: {quote(theirs)} stands for {fed[theirs]} and for {name}"
            )
    for name in entry.values:
        if name in entry.variables.values() or (name in parameters and name not in entry.unused):
            raise _ConflictError(f"{where}.values: {quote(name)} is set by the campaign already")
    archive = Path(entry.path)
    try:
        known_as = "no such file" if not archive.exists() else "" if archive.is_file() else "is not a file"
    except OSError as error:
        known_as = error.strerror or str(error)
    if known_as:
        raise _ConflictError(f"{where}.path: {_shown(archive)}: {known_as}")
    return Replacement(
        component.model,
        archive,
        dict(entry.variables),
        tuple(entry.unused),
        dict(entry.values),
        entry.sha256,
    )


def _truth(table: CampaignTable) -> Truth:
    given = table.truth.model_dump(exclude_unset=True)
    epochs = {int(key.removeprefix("delta_ifo_")): given.pop(key) for key in list(given) if "ifo" in key}
    truth = Truth(**given, delta_ifo={**Truth().delta_ifo, **epochs})
    for j, delay in ((1, truth.C_1 / truth.lambda_1), (2, truth.C_2 / truth.lambda_2)):
        if delay < H / 2:
            raise _ConflictError(
                f"truth.C_{j}: C_{j}/lambda_{j} = {delay:.4g} s is below {H / 2:g} s, the half sample "
                "that the hold of a command already takes of its effective delay"
            )
        if delay > LONGEST_DELAY:
            raise _ConflictError(
                f"truth.C_{j}: C_{j}/lambda_{j} = {delay:.4g} s is above {LONGEST_DELAY:g} s, too long for "
                "the delay of a command"
            )
    return truth


def _experiment(table: CampaignTable, entry: ExperimentTable, where: str, truth: Truth) -> Experiment:
    if entry.authority not in table.authority:
        known = closest(entry.authority, table.authority)
        raise _ConflictError(f"{where}.authority: no authority set {quote(entry.authority)}{known}")
    if entry.alignment_epoch not in truth.delta_ifo:
        k = entry.alignment_epoch
        known = ", ".join(str(k) for k in sorted(truth.delta_ifo))
        raise _ConflictError(
            f"{where}.alignment_epoch: there is no truth.delta_ifo_{k} (known epochs: {known})"
        )
    authority = Authority(entry.authority, **table.authority[entry.authority].model_dump())
    if not entry.duration and not entry.noise_duration:
        raise _ConflictError(f'{where}.duration: missing, write duration = "6 h", or noise_duration alone')
    levels = {**table.noise.model_dump(), **entry.noise.model_dump(exclude_unset=True)}

    placed: list[tuple[str, Injection]] = []
    for k, name in enumerate(entry.sequences):
        if name not in table.sequences:
            known = closest(name, table.sequences)
            raise _ConflictError(f"{where}.sequences[{k}]: no sequence {quote(name)}{known}")
        placed += [(f"sequences.{name}[{n}]", s.record()) for n, s in enumerate(table.sequences[name])]
    placed += [(f"{where}.injections[{n}]", s.record()) for n, s in enumerate(entry.injections)]
    for place, injection in placed:
        if injection.end > entry.duration + 1e-6:
            raise _ConflictError(
                f'{place}: ends at {injection.end:.7g} s, past the end of experiment "{entry.name}" '
                f"at {entry.duration:.7g} s"
            )
    _check_forces(placed, entry, where, authority, truth)
    return Experiment(
        name=entry.name,
        authority=authority,
        alignment_epoch=entry.alignment_epoch,
        n_samples=round(entry.duration * FS),
        n_noise_samples=round(entry.noise_duration * FS),
        dc=entry.dc,
        noise=Noise(**levels),
        injections=tuple(injection for _, injection in placed),
        sample_rate=entry.sample_rate,
        inertial_period=entry.inertial_period or 0,
        t0=iso(entry.t0) if entry.t0 else None,
        spacecraft=_spacecraft(table.spacecraft, entry, where),
    )


def _spacecraft(table: SpacecraftTable | None, entry: ExperimentTable, where: str) -> object:
    if table is None:
        return None
    period = entry.inertial_period
    if period is not None and str(period) not in table.period:
        known = ", ".join(table.period) or "none"
        raise _ConflictError(
            f"{where}.inertial_period: there is no spacecraft.period.{period} (known periods: {known})"
        )
    return table.equipment(period)


def _check_forces(
    placed: Sequence[tuple[str, Injection]],
    entry: ExperimentTable,
    where: str,
    authority: Authority,
    truth: Truth,
) -> None:
    """Refuse a force, with whatever acts at the same time, that the authority would clip."""
    holding = abs(entry.dc) * M_TM / truth.lambda_2
    if holding >= authority.F_max_2:
        raise _ConflictError(
            f"{where}.dc: holding it takes {_pN(holding)} of the {_pN(authority.F_max_2)} that authority set "
            f'"{authority.name}" gives to test mass 2, which leaves nothing to control with'
        )
    for j, held, F_max in ((1, 0.0, authority.F_max_1), (2, holding, authority.F_max_2)):
        forces = [(place, s) for place, s in placed if s.into == f"F_x_{j}"]
        for place, latest in forces:
            total = held + sum(
                s.amplitude for _, s in forces if s.start <= latest.start and not _over(s, latest.start)
            )
            if total > F_max:
                also = "" if total == latest.amplitude else " with what acts at the same time"
                raise _ConflictError(
                    f"{place}.amplitude: the force on test mass {j} reaches {_pN(total)}{also}, "
                    f'authority set "{authority.name}" allows {_pN(F_max)}'
                )


def _over(injection: Injection, time: float) -> bool:
    return isinstance(injection, Sine) and injection.end <= time


def _pN(force: float) -> str:
    return f"{force * 1e12:.4g} pN"
