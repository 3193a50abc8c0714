"""A campaign: a TOML file, checked, as the runs that are to be simulated.

What is wrong with a file is said in one sentence that gives the path inside it, such as
``quickstart.toml: experiments[2].injections[0].frequency: "6 Hz" is not below …``.
"""

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from fit.errors import quote
from fit.files import closest, told
from lpfcosim.campaign import file as merged
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
    Controller,
    H,
    Injection,
    Kind,
    Noise,
    Replacement,
    Run,
    Sine,
    Spacecraft,
    Truth,
)
from lpfcosim.worlds import world_of


@dataclass(frozen=True)
class Experiment:
    """A sysid run of ``n_samples`` samples, preceded by a noise run of ``n_noise_samples``; 0: none. SI.

    Without a start ``t0`` of its own it follows the experiment before it.
    """

    name: str
    authority: Authority
    alignment_epoch: int
    n_samples: int
    n_noise_samples: int
    dc: float
    noise: Noise
    injections: tuple[Injection, ...]
    sample_rate: float = FS
    inertial_period: int = 0
    spacecraft: Spacecraft | None = None
    t0: str | None = None

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of its runs in the order they take place."""
        noise = (f"{self.name}-noise",) if self.n_noise_samples else ()
        return (*noise, self.name) if self.n_samples else noise


@dataclass(frozen=True)
class Campaign:
    """A validated campaign; ``t0`` is the start of its first run, ISO 8601 UTC.

    ``fit`` is what the file says about the fit, ``tables`` all that it says together with what it extends, as
    written.
    """

    name: str
    seed: int
    t0: str
    truth: Truth
    drag_free: Controller
    suspension: Controller
    experiments: tuple[Experiment, ...]
    replacements: tuple[Replacement, ...] = ()
    fit: Mapping[str, object] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Every run in the order they take place."""
        runs: list[Run] = []
        start = datetime.fromisoformat(self.t0)
        for experiment in self.experiments:
            start = datetime.fromisoformat(experiment.t0) if experiment.t0 else start
            for name in experiment.run_names:
                runs.append(self._run(experiment, name, start))
                start += timedelta(seconds=runs[-1].n_samples / FS)
        return tuple(runs)

    def _run(self, experiment: Experiment, name: str, start: datetime) -> Run:
        kind: Kind = "sysid" if name == experiment.name else "noise"
        return Run(
            name=name,
            experiment=experiment.name,
            kind=kind,
            n_samples=experiment.n_samples if kind == "sysid" else experiment.n_noise_samples,
            authority=experiment.authority,
            alignment_epoch=experiment.alignment_epoch,
            t0=_iso(start),
            truth=self.truth.of_experiment(experiment.name, self.seed),
            noise=experiment.noise,
            dc=experiment.dc,
            injections=experiment.injections if kind == "sysid" else (),
            drag_free=self.drag_free,
            suspension=self.suspension,
            seed=self.seed,
            replacements=self.replacements,
            sample_rate=experiment.sample_rate,
            inertial_period=experiment.inertial_period,
            spacecraft=experiment.spacecraft,
        )

    @cached_property
    def digest(self) -> str:
        """SHA-256 of what the file says: comments, order of keys and choice of units do not count.

        Nor does where an FMU lies; what it is stands beside this digest in the provenance. Nor what is said
        of the fit, which changes nothing in the telemetry.
        """
        said = asdict(self)
        del said["fit"], said["tables"]
        for replacement in said["replacements"]:
            del replacement["archive"], replacement["sha256"]
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def load(path: Path) -> Campaign:
    """Read a campaign file.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or is not a campaign; one sentence with the path inside it.
    """
    raw = merged.read(path)
    try:
        found = _build(CampaignTable.model_validate(raw))
    except ValidationError as error:
        raise InputError(f"{path}: {told(error, SHAPES)}") from None
    except _ConflictError as error:
        raise InputError(f"{path}: {error}") from None
    return replace(found, tables={key: value for key, value in raw.items() if key != "extends"})


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a campaign file, for editors that complete and check as one types."""
    return CampaignTable.model_json_schema(by_alias=True)


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
        t0=_iso(table.t0),
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
                f"at {_iso(end)}"
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
        t0=_iso(entry.t0) if entry.t0 else None,
        spacecraft=_spacecraft(table.spacecraft, entry, where),
    )


def _spacecraft(table: SpacecraftTable | None, entry: ExperimentTable, where: str) -> Spacecraft | None:
    if table is None:
        return None
    aligned = {}
    if entry.inertial_period is not None:
        period = table.period.get(str(entry.inertial_period))
        if period is None:
            known = ", ".join(table.period) or "none"
            raise _ConflictError(
                f"{where}.inertial_period: there is no spacecraft.period.{entry.inertial_period} "
                f"(known periods: {known})"
            )
        aligned = period.model_dump()
    return Spacecraft(
        b=(table.b_1, table.b_2, table.b_3, table.b_4, table.b_5, table.b_6),
        Omega_DC=(table.Omega_theta, table.Omega_eta, table.Omega_phi),
        lambda_N=table.lambda_N,
        leak_phi_1=table.leak_phi_1,
        kappa_phi=table.kappa_phi,
        kappa_eta=table.kappa_eta,
        **aligned,
    )


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


def _iso(time: datetime) -> str:
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")
