"""A campaign as the experiments that are planned."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fit.forecasting import PlannedExperiment, PlannedNoiseRun
from fit.model import rotation
from fit.telemetry import Telemetry
from fit.whitening import Experiment
from fit.whitening import Run as Flown
from lpfcosim.campaign import Campaign
from lpfcosim.execution import telemetry_file
from lpfcosim.linear import planning, stability
from lpfcosim.models import world_of
from lpfcosim.spacecraft import Run


def planned(plan: Campaign) -> list[PlannedExperiment]:
    """Return the sysid runs of a campaign as they are expected, without noise and with its cross-spectra.

    Raises
    ------
    InputError
        If a loop is unstable.
    """
    noisy = {run.experiment for run in plan.runs if run.kind == "noise"}
    driven = [run for run in plan.runs if run.kind == "sysid"]
    stability.check(*driven)
    return [
        PlannedExperiment(
            partial(_flown, run, noisy=run.experiment in noisy),
            partial(planning.cross_spectra, run),
            telemetry_file.truth(run),
        )
        for run in driven
    ]


def turning(runs: Sequence[Run]) -> list[PlannedNoiseRun]:
    """Return those of the runs that the inertial calibration may use: noise of the whole spacecraft.

    Raises
    ------
    InputError
        If a loop is unstable.
    """
    steered = [run for run in runs if run.kind == "noise" and world_of(run).turns(run)]
    stability.check(*steered)
    return [_turning(run) for run in steered]


def _turning(run: Run) -> PlannedNoiseRun:
    still = np.broadcast_to(0.0, round(run.n_samples / run.fs * planning.RATE))
    rates = world_of(run).turns(run)
    phi, eta = (rates.get(f"attitude_{axis}", 0.0) for axis in rotation.AXES)
    channels = dict.fromkeys(world_of(run).record, still)
    return PlannedNoiseRun(in_memory(run, channels), partial(planning.cross_spectra, run), (phi, eta))


def _flown(run: Run, *, noisy: bool) -> Experiment:
    """Return an experiment without noise; `noisy`: whether it has a noise run."""
    flown = Flown(in_memory(run, planning.response(run)))
    return Experiment(flown, flown if noisy else None)


def in_memory(run: Run, channels: Mapping[str, np.ndarray[tuple[int], np.dtype[np.float64]]]) -> Telemetry:
    """Return channels at 1 Hz as the telemetry of a run."""
    said = telemetry_file.attributes(run)
    known = {f.name: said[f.name] for f in fields(Telemetry) if f.name in said}
    n = channels["o_1"].size
    more: Any = {
        **known,
        "path": Path(run.name),
        "fs": planning.RATE,
        "time": np.arange(n) / planning.RATE,
        "channels": channels,
        "units": {},
        "attributes": {name: value for name, value in said.items() if name not in (*known, "schema")},
    }
    return Telemetry(**more)
