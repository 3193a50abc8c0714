"""An experiment: an injection run and its adjacent noise run, and which experiments are fitted jointly."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.parallel import parallel_map
from fit.requirements import SHORTEST
from fit.settings import Settings
from fit.telemetry import Telemetry
from fit.whitening.run import Run

Array = NDArray[np.float64]

TRIMMED = 0.005  # fraction a decimation may have cut from a run's ends


@dataclass(frozen=True)
class Experiment:
    """A system identification run and its adjacent noise run.

    Attributes
    ----------
    sysid : Run
        With injections.
    noise : Run or None
        Without, None where there is none.
    marginalised : bool
        Whether the level of the noise is marginalised in narrow bands, being not that of the noise run.
    readout_excess : bool
        Whether only the injected signal of o_1 is used, see `fit.fitting.readout_excess_noise`.
    """

    sysid: Run
    noise: Run | None
    marginalised: bool = False
    readout_excess: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the K parameters of the experiment: those its sysid run can be fitted for."""
        return self.sysid.channels.parameters

    @property
    def runs(self) -> tuple[Run, ...]:
        """The sysid run, and the noise run if there is one."""
        return (self.sysid, self.noise) if self.noise else (self.sysid,)

    @property
    def name(self) -> str:
        """Name that pairs the two."""
        return self.sysid.telemetry.experiment

    def limit_band(self, f_max: float) -> "Experiment":
        """Return the experiment with another end of the fitted band [Hz]."""
        return replace(
            self, sysid=self.sysid.limit_band(f_max), noise=self.noise and self.noise.limit_band(f_max)
        )

    def with_parameters(self, names: Iterable[str]) -> "Experiment":
        """Return the experiment with those of the named parameters that are taken as exact otherwise."""
        sysid, noise = self.sysid.with_parameters(names), self.noise and self.noise.with_parameters(names)
        return replace(self, sysid=sysid, noise=noise)

    def samples(self) -> int:
        """Return the number of samples of both runs, a measure of the time that their tests take."""
        return self.sysid.telemetry.size + (self.noise.telemetry.size if self.noise else 0)


def pair(telemetries: Sequence[Telemetry]) -> list[Experiment]:
    """Pair each sysid run with the noise run of the same experiment, where there is one.

    Raises
    ------
    InputError
        If there are two of a kind, or one is too short.
    """
    return parallel_map(_experiment, pair_runs(telemetries))


def pair_runs(telemetries: Sequence[Telemetry]) -> list[tuple[Telemetry, Telemetry | None]]:
    """Return the telemetry of each sysid run and of its noise run; raises as `pair`."""
    _check_names(telemetries)
    driven = [run for run in telemetries if run.kind == "sysid"]
    noise = {run.experiment: run for run in telemetries if run.kind == "noise"}
    pairs = [(sysid, noise.get(sysid.experiment)) for sysid in driven]
    for run in (run for both in pairs for run in both if run is not None):
        if run.duration < SHORTEST:
            raise InputError(f"{run.path}: lasts {run.duration:.6g} s, expected at least {SHORTEST:g} s")
    return pairs


def divide(
    experiments: Sequence[Experiment], settings: Settings
) -> tuple[list[Experiment], list[Experiment], list[Experiment]]:
    """Return the experiments that take part in the joint fit, those too short for it, and those excluded.

    Raises
    ------
    InputError
        If an experiment that the settings exclude is not there.
    """
    names = [e.name for e in experiments]
    for name in settings.exclude:
        if name not in names:
            raise InputError(f"fit.exclude: no experiment {name!r}, there are {', '.join(names)}")
    excluded = [e for e in experiments if e.name in settings.exclude]
    short = [
        e
        for e in experiments
        if e.sysid.telemetry.duration < e.sysid.spacecraft.shortest * (1 - TRIMMED)
        and not settings.include_short
    ]
    return [e for e in experiments if e not in (*excluded, *short)], short, excluded


def _check_names(telemetries: Sequence[Telemetry]) -> None:
    """Refuse two sysid runs of one experiment, and two noise runs of one that has a sysid run."""
    driven = {run.experiment for run in telemetries if run.kind == "sysid"}
    runs: dict[tuple[str, str], Telemetry] = {}
    for run in telemetries:
        twin = runs.setdefault((run.experiment, run.kind), run)
        if twin is not run and run.experiment in driven:
            raise InputError(
                f"{run.path}: experiment {run.experiment!r} already has the {run.kind} run {twin.path}, "
                "expected one"
            )


def _experiment(runs: tuple[Telemetry, Telemetry | None]) -> Experiment:
    sysid, noise = runs
    return Experiment(Run(sysid), None if noise is None else Run(noise))
