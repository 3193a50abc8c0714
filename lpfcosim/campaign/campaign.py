"""A campaign: its experiments, and the runs that are to be simulated."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any

from lpfcosim.campaign import history
from lpfcosim.campaign.design_table import DesignTable
from lpfcosim.campaign.identify_table import IdentifyTable
from lpfcosim.signals import generator
from lpfcosim.spacecraft import (
    FS,
    Actuation,
    Authority,
    Controller,
    Events,
    Injection,
    Kind,
    Noise,
    Replacement,
    Run,
    Spacecraft,
    Truth,
)

#: Fields of a campaign that change nothing in its telemetry.
_NOT_SIMULATED = ("fit", "design", "identify", "tables")


@dataclass(frozen=True)
class Experiment:
    """A sysid run of ``n_samples`` samples, preceded by a noise run of ``n_noise_samples``; 0: none. SI.

    Without a start ``t0`` of its own it follows the experiment before it. ``plateau``: its noise by date, ISO
    8601, where that goes before the level in ``noise``.
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
    spacecraft: object = None
    t0: str | None = None
    plateau: tuple[tuple[str, float], ...] = ()

    @property
    def run_names(self) -> tuple[str, ...]:
        """Names of its runs in the order they take place."""
        noise = (f"{self.name}-noise",) if self.n_noise_samples else ()
        return (*noise, self.name) if self.n_samples else noise


@dataclass(frozen=True)
class Campaign:
    """A validated campaign; ``t0`` is the start of its first run, ISO 8601 UTC.

    ``parameters`` and ``controllers`` are those of all runs, see `Run`. ``events`` apply to all runs;
    ``tail_scatter`` is the scatter of the 1/f noise of Delta g between experiments. ``fit``, ``design`` and
    ``identify`` are the tables of these names; ``tables`` has all tables as written, including those of the
    campaign that the file extends.
    """

    name: str
    seed: int
    t0: str
    truth: Truth
    drag_free: Controller
    suspension: Controller
    experiments: tuple[Experiment, ...]
    actuation: Actuation = field(default_factory=Actuation)
    replacements: tuple[Replacement, ...] = ()
    events: Events | None = None
    tail_scatter: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    controllers: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fit: Mapping[str, object] = field(default_factory=dict)
    design: DesignTable = field(default_factory=DesignTable)
    identify: Mapping[str, IdentifyTable] = field(default_factory=dict)
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
        n_samples = experiment.n_samples if kind == "sysid" else experiment.n_noise_samples
        craft = experiment.spacecraft
        if isinstance(craft, Spacecraft):  # one value a run, that of its middle
            since = (start - datetime.fromisoformat(self.t0)).total_seconds()
            craft = craft.after(since + n_samples / FS / 2)
        noise = history.plateau_at(experiment.noise, experiment.plateau, start)
        return Run(
            name=name,
            experiment=experiment.name,
            kind=kind,
            n_samples=n_samples,
            authority=experiment.authority,
            alignment_epoch=experiment.alignment_epoch,
            t0=iso(start),
            truth=self.truth.scattered(generator(self.seed, experiment.name, "gains")),
            noise=history.scatter_tail(noise, self.tail_scatter, experiment.name, self.seed),
            actuation=self.actuation,
            dc=experiment.dc,
            injections=experiment.injections if kind == "sysid" else (),
            drag_free=self.drag_free,
            suspension=self.suspension,
            seed=self.seed,
            replacements=self.replacements,
            sample_rate=experiment.sample_rate,
            inertial_period=experiment.inertial_period,
            spacecraft=craft,
            parameters=self.parameters,
            controllers=self.controllers,
            events=self.events,
            about=self.truth if self.truth.lambda_scatter else None,
        )

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the canonical JSON of what is simulated: keys sorted, values in SI.

        Comments, order of keys and choice of units change nothing, nor do the fit, the design and the
        identification, nor where an FMU lies: its own digest accompanies this one in the provenance.
        """
        inputs = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _NOT_SIMULATED}
        inputs["replacements"] = [
            {
                "model": replacement.model,
                "variables": replacement.variables,
                "unused": replacement.unused,
                "step": replacement.step,
                "values": {name: _number(value) for name, value in replacement.values.items()},
            }
            for replacement in self.replacements
        ]
        text = json.dumps(inputs, sort_keys=True, default=asdict)
        return hashlib.sha256(text.encode()).hexdigest()


def _number(value: bool | int | float | str) -> bool | int | float | str:
    """Return an integer as the float that equals it, if one does: 2 and 2.0 are one number."""
    exact = isinstance(value, int) and not isinstance(value, bool) and abs(value) <= 2**53
    return float(value) if exact else value


def iso(time: datetime) -> str:
    """Return a time in ISO 8601, UTC."""
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")
