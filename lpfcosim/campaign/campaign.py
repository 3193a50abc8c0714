"""A campaign: its tables as a file has them, and the runs that are to be simulated."""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, field, fields, is_dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, Strict, ValidationInfo, model_validator
from pydantic.dataclasses import dataclass
from pydantic_core import PydanticCustomError

from fit.errors import quote
from fit.files import closest_match, problem
from lpfcosim.campaign.design_table import DesignTable
from lpfcosim.campaign.identify_table import IdentifyTables
from lpfcosim.errors import InputError
from lpfcosim.models import SpacecraftModel, registered
from lpfcosim.quantities import (
    Acceleration,
    Duration,
    Name,
    Record,
    SampleRate,
    Utc,
    declared_values,
)
from lpfcosim.signals import generator
from lpfcosim.spacecraft import FS, Authority, Events, Injection, Kind, Replacement, Run

#: Fields of a campaign that change nothing in its telemetry.
_NOT_SIMULATED = ("fit", "design", "identify", "tables", "fmus")


def _truth(raw: object, info: ValidationInfo) -> object:
    values = _of_period(raw, info)
    return values if info.context is None else {**info.context.stated_truth, **_plain_table(values)}


def _of_period(raw: object, info: ValidationInfo) -> object:
    return raw if info.context is None else _declared(raw, info.context, "truth_keys")


def _levels(raw: object, info: ValidationInfo) -> object:
    return raw if info.context is None else _declared(raw, info.context, "noise_keys")


def _declared(raw: object, spacecraft: SpacecraftModel, table: str) -> dict[str, float]:
    """Return the values of a table of `spacecraft`; say of a key which other spacecraft has it."""
    known = getattr(spacecraft, table)
    for key in _plain_table(raw):
        owners = [owner.key for owner in registered().values() if key in getattr(owner, table)]
        if key not in known and owners:
            raise problem(f'unknown key of this spacecraft; spacecraft = "{owners[0]}" has it', key)
    return declared_values(_plain_table(raw), known)


def _plain_table(raw: object) -> dict[str, object]:
    if not isinstance(raw, dict):
        raise problem(f"{quote(raw)} is not a table of keys and values")
    return raw


def _control(raw: object, info: ValidationInfo) -> object:
    if info.context is None or not isinstance(raw, dict):
        return raw
    known, values = info.context.control_keys, {**info.context.stated_control}
    for model, keys in raw.items():
        if model not in known:
            raise problem(f"no such controller{closest_match(model, known)}", model)
        if not isinstance(keys, dict):
            raise problem("expected a table of keys and values", model)
        try:
            values[model] = values[model] | declared_values(keys, known[model])
        except PydanticCustomError as error:
            raise problem(f"{(error.context or {})['key']}: {error.message()}", model) from None
    return values


def _named(key: str) -> BeforeValidator:
    """Return a validator that gives each of the records in a table its name there."""

    def with_names(raw: object) -> object:
        if not isinstance(raw, dict):
            return raw
        return {
            name: {**entry, key: name} if isinstance(entry, dict) else entry for name, entry in raw.items()
        }

    return BeforeValidator(with_names)


Injections = tuple[Annotated[Injection, Field(discriminator="shape")], ...]
Values = dict[str, Annotated[float, Field(allow_inf_nan=False)]]
Levels = Annotated[Values, BeforeValidator(_levels)]


@dataclass(frozen=True)
class Experiment(Record):
    """A run with injections, preceded by its noise run; or a noise run only. SI.

    Without a start ``t0`` of its own it follows the experiment before it. ``noise`` replaces single levels of
    those of the campaign; an ``inertial_period`` of 0 is none.
    """

    name: Annotated[Name, Field(examples=["A"])]
    authority: Annotated[str, Strict(), Field(examples=["A"])]
    alignment_epoch: Annotated[int, Strict(), Field(ge=1, le=9999)] = 1
    inertial_period: Annotated[int, Strict(), Field(ge=0, le=9999)] = 0
    t0: Utc | None = None
    duration: Duration = 0.0
    noise_duration: Duration = 0.0
    sample_rate: SampleRate = FS
    dc: Acceleration = 0.0
    noise: Levels = field(default_factory=dict)
    injections: Injections = ()

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of its runs in the order they take place."""
        noise = (f"{self.name}-noise",) if self.noise_duration else ()
        return (*noise, self.name) if self.duration else noise


@dataclass(frozen=True)
class Campaign(Record):
    """A validated campaign; ``t0`` is the start of its first run.

    ``spacecraft`` names the spacecraft model, which declares the names in ``truth``, ``inertial_period``,
    ``control`` and ``noise``. ``tables`` has the tables of its file, including those of the campaign that it
    extends.

    Raises
    ------
    InputError
        If a value is none that a campaign can have, or two of them do not go together.
    """

    name: Annotated[Name, Field(examples=["quickstart"])]
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**63, examples=[1])]
    authority: Annotated[dict[Name, Authority], _named("name")]
    experiments: Annotated[tuple[Experiment, ...], Field(min_length=1)]
    t0: Utc = datetime(2016, 3, 1, tzinfo=UTC)
    spacecraft: str = "lpf-x"
    truth: Annotated[Values, BeforeValidator(_truth)] = field(default_factory=dict)
    inertial_period: dict[str, Annotated[Values, BeforeValidator(_of_period)]] = field(default_factory=dict)
    control: Annotated[dict[str, Values], BeforeValidator(_control)] = field(default_factory=dict)
    noise: Levels = field(default_factory=dict)
    events: Events | None = None
    fmus: Annotated[dict[str, Replacement], _named("model")] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)
    design: DesignTable = field(default_factory=DesignTable)
    identify: IdentifyTables = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def model(self) -> SpacecraftModel:
        """Its spacecraft model."""
        return registered()[self.spacecraft]

    @property
    def replacements(self) -> tuple[Replacement, ...]:
        """FMUs of others in its loop."""
        return tuple(self.fmus.values())

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Every run in the order they take place."""
        runs: list[Run] = []
        start = self.t0
        for experiment in self.experiments:
            start = experiment.t0 or start
            for name in experiment.run_names:
                runs.append(self._run(experiment, name, start))
                start += timedelta(seconds=runs[-1].n_samples / FS)
        return tuple(runs)

    def _run(self, experiment: Experiment, name: str, start: datetime) -> Run:
        kind: Kind = "sysid" if name == experiment.name else "noise"
        n_samples = round((experiment.duration if kind == "sysid" else experiment.noise_duration) * FS)
        # one value a run, that of its middle
        truth = self._truth_at(experiment, (start - self.t0).total_seconds() + n_samples / FS / 2)
        return Run(
            name=name,
            experiment=experiment.name,
            kind=kind,
            n_samples=n_samples,
            authority=self.authority[experiment.authority],
            spacecraft=self.spacecraft,
            alignment_epoch=experiment.alignment_epoch,
            t0=iso(start),
            truth=self.model.scattered(truth, generator(self.seed, experiment.name, "gains")),
            control=self.control,
            noise=self._noise(experiment, start),
            dc=experiment.dc,
            injections=experiment.injections if kind == "sysid" else (),
            seed=self.seed,
            replacements=self.replacements,
            sample_rate=experiment.sample_rate,
            inertial_period=experiment.inertial_period,
            events=self.events,
            about=self.truth if self.truth.get("lambda_scatter") else None,
        )

    def _truth_at(self, experiment: Experiment, since: float) -> dict[str, float]:
        """Return the truth in the period of an experiment, so long after the start of the campaign [s]."""
        truth = self.truth | self.inertial_period.get(str(experiment.inertial_period), {})
        for name in self.model.drifting:
            if rate := truth.get(f"{name}_drift"):
                truth[name] += rate * since
        return truth

    def _noise(self, experiment: Experiment, start: datetime) -> dict[str, float]:
        """Return the levels of noise of a run: the plateau by date, the tail scattered log-normally."""
        noise = self.noise | experiment.noise
        if self.events and self.events.plateau and "plateau" not in experiment.noise:
            noise["plateau"] = self.events.plateau_at(start)
        if self.events and self.events.tail_scatter and "tail" in noise:
            normal = generator(self.seed, experiment.name, "tail").standard_normal()
            noise["tail"] = float(noise["tail"] * np.exp(self.events.tail_scatter * normal))
        return noise

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.spacecraft not in registered():
            match = closest_match(self.spacecraft, registered())
            raise InputError(f"spacecraft: no spacecraft {quote(self.spacecraft)}{match}")
        for place, table, keys in self._declared_tables():  # of a campaign that was changed in Python
            for key in table:
                if key not in keys:
                    raise InputError(f"{place}.{key}: unknown key{closest_match(key, keys)}")
        owners: dict[str, str] = {}
        for i, experiment in enumerate(self.experiments):
            if fault := self._fault(i, experiment, owners):
                raise InputError(f"experiments[{i}].{fault}")
        for previous, run in pairwise(self.runs):
            end = datetime.fromisoformat(previous.t0) + timedelta(seconds=previous.n_samples / FS)
            if datetime.fromisoformat(run.t0) < end:
                raise InputError(
                    f"experiments: t0: {quote(run.experiment)} begins at {run.t0}, before "
                    f"{quote(previous.experiment)} ends, at {iso(end)}"
                )
        for run in self.runs:
            self.model.check(run)
        return self

    def _declared_tables(self) -> Iterator[tuple[str, Collection[str], Collection[str]]]:
        """Yield the tables with keys that the spacecraft declares: place, keys, and known keys."""
        model = self.model
        yield "truth", self.truth, model.truth_keys
        yield "noise", self.noise, model.noise_keys
        yield "control", self.control, model.control_keys
        for name, law in self.control.items():
            yield f"control.{name}", law, model.control_keys[name]
        for k, values in self.inertial_period.items():
            yield f"inertial_period.{k}", values, model.truth_keys
        for i, experiment in enumerate(self.experiments):
            yield f"experiments[{i}].noise", experiment.noise, model.noise_keys

    def _fault(self, i: int, experiment: Experiment, owners: dict[str, str]) -> str:
        """Return what of experiment i does not go together with the rest; `owners` are those of run names."""
        e, place = experiment, f"experiments[{i}]"
        if e.authority not in self.authority:
            known = closest_match(e.authority, self.authority)
            return f"authority: no authority set {quote(e.authority)}{known}"
        if self.inertial_period and e.inertial_period and str(e.inertial_period) not in self.inertial_period:
            known = ", ".join(self.inertial_period)
            return f"inertial_period: there is no table inertial_period.{e.inertial_period} (known: {known})"
        if not e.run_names:
            return 'duration: missing, write duration = "6 h", or noise_duration alone'
        if e.dc and "f_x_2_start" not in self.model.units:
            return f"dc: nothing holds it in runs {self.model.name}"
        for injection in e.injections:
            if injection.end > e.duration + 1e-6:
                return (
                    f"injections: one into {injection.into} ends at {injection.end:.7g} s, past the end of "
                    f"{quote(e.name)} at {e.duration:.7g} s"
                )
        for name in e.run_names:
            if (owner := owners.setdefault(name.casefold(), place)) != place:
                return f"name: there would be two runs named {quote(name)}, the other of {owner}"
        return ""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the canonical JSON of what is simulated: keys sorted, values in SI.

        Comments, order of keys and choice of units change nothing, nor do the fit, the design and the
        identification, nor where an FMU lies: its own digest accompanies this one in the provenance.
        """
        inputs = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _NOT_SIMULATED}
        inputs["fmus"] = {
            model: {
                "variables": replacement.variables,
                "unused": replacement.unused,
                "step": replacement.step,
                "values": {name: _number(value) for name, value in replacement.values.items()},
            }
            for model, replacement in self.fmus.items()
        }
        text = json.dumps(inputs, sort_keys=True, default=_plain)
        return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: object) -> object:
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else str(value)


def _number(value: bool | int | float | str) -> bool | int | float | str:
    """Return an integer as the float that equals it, if one does: 2 and 2.0 are one number."""
    exact = isinstance(value, int) and not isinstance(value, bool) and abs(value) <= 2**53
    return float(value) if exact else value


def iso(time: datetime) -> str:
    """Return a time in ISO 8601, UTC."""
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")
