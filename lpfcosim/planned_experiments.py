"""The runs of a campaign as `fit.forecasting` expects them: responses and spectra of the closed loop."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.fitting import joint_parameters
from fit.forecasting import PlannedExperiment, PlannedNoiseRun, expected_fit
from fit.model import rotation
from fit.settings import Settings
from fit.telemetry import Telemetry
from fit.whitening import Experiment, divide
from fit.whitening import Run as FitRun
from lpfcosim.campaign import Campaign
from lpfcosim.execution import telemetry_file
from lpfcosim.linear import response, stability
from lpfcosim.models import model_of
from lpfcosim.spacecraft import Run

Array = NDArray[np.float64]

LISA = "lisa"  # the equation of motion of one LISA spacecraft


def planned_experiments(campaign: Campaign) -> list[PlannedExperiment]:
    """Return the sysid runs of a campaign, noise-free, with the cross-spectra of their noise.

    Raises
    ------
    InputError
        If a loop is unstable.
    """
    with_noise_run = {run.experiment for run in campaign.runs if run.kind == "noise"}
    sysid_runs = [run for run in campaign.runs if run.kind == "sysid"]
    stability.check(*sysid_runs)
    return [
        PlannedExperiment(
            partial(_noise_free, run, has_noise_run=run.experiment in with_noise_run),
            partial(response.cross_spectra, run),
            telemetry_file.truth(run),
        )
        for run in sysid_runs
    ]


def check_parameters(campaign: Campaign, settings: Settings) -> None:
    """Refuse names of experiments and parameters that the joint fit of a campaign will not have.

    Raises
    ------
    InputError
        If there are any.
    """
    sysid_runs = [run for run in campaign.runs if run.kind == "sysid" and model_of(run).equation]
    experiments = [Experiment(FitRun(telemetry_of(run, _still(run))), None) for run in sysid_runs]
    if experiments:
        divide(experiments, settings)
    if experiments and settings.parameters:
        parameters, _, _ = joint_parameters(experiments, settings)
        expected_fit.joint_params(settings, parameters)


def _still(run: Run) -> dict[str, Array]:
    """Return channels without any motion, at 1 Hz."""
    n = round(run.n_samples / run.fs * response.RATE)
    return dict.fromkeys(model_of(run).record, np.broadcast_to(0.0, n))


def planned_noise_runs(runs: Sequence[Run]) -> list[PlannedNoiseRun]:
    """Return the noise runs of the whole spacecraft, which the inertial calibration may use.

    Raises
    ------
    InputError
        If a loop is unstable.
    """
    rotating = [run for run in runs if run.kind == "noise" and model_of(run).attitude_rates(run)]
    stability.check(*rotating)
    return [_planned_noise_run(run) for run in rotating]


def _planned_noise_run(run: Run) -> PlannedNoiseRun:
    rates = model_of(run).attitude_rates(run)
    phi, eta = (rates.get(f"attitude_{axis}", 0.0) for axis in rotation.AXES)
    return PlannedNoiseRun(telemetry_of(run, _still(run)), partial(response.cross_spectra, run), (phi, eta))


def _noise_free(run: Run, *, has_noise_run: bool) -> Experiment:
    noise_free = FitRun(telemetry_of(run, response.linear_response(run)))
    return Experiment(noise_free, noise_free if has_noise_run else None)


def telemetry_of(run: Run, channels: Mapping[str, Array]) -> Telemetry:
    """Return the telemetry of a run in memory.

    Parameters
    ----------
    run : Run
        Gives the attributes of the telemetry.
    channels : mapping of str to ndarray, shape (n,)
        At 1 Hz.
    """
    attributes = telemetry_file.attributes(run)
    known = {f.name: attributes[f.name] for f in fields(Telemetry) if f.name in attributes}
    n = next(iter(channels.values())).size
    values: Any = {
        **known,
        "path": Path(run.name),
        "fs": response.RATE,
        "time": np.arange(n) / response.RATE,
        "channels": channels,
        "units": {},
        "attributes": {name: value for name, value in attributes.items() if name not in (*known, "schema")},
    }
    return Telemetry(**values)
