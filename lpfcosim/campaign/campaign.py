"""A campaign: its experiments, and the runs that are to be simulated."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any

from lpfcosim.spacecraft import FS, Authority, Controller, Injection, Kind, Noise, Replacement, Run, Truth


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
    spacecraft: object = None
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
            t0=iso(start),
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


def iso(time: datetime) -> str:
    """Return a time in ISO 8601, UTC."""
    return time.astimezone(UTC).isoformat().replace("+00:00", "Z")
