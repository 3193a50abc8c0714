"""A design in the time domain: its runs without noise, stepped through the FMUs, against their limits."""

import tempfile
from collections.abc import Mapping, Set
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.parallel import update_progress
from fit.telemetry import read_all
from lpfcosim.campaign import Campaign
from lpfcosim.experiment_design import Design, limits, with_tones
from lpfcosim.spacecraft import FS, Actuation, Noise
from lpfcosim.workflows.simulate import simulate

TOLERANCE = 1e-3  # relative, by which a limit may be exceeded and still counts as kept

Array = NDArray[np.float64]
LimitRatios = Mapping[str, Mapping[str, float]]  # what is reached of each limit, by experiment and limit


def verify_in_time_domain(design: Design, jobs: int | None) -> LimitRatios:
    """Return what every run reaches of its limits, stepped through the FMUs.

    Raises
    ------
    RunError
        If a run fails.
    """
    experiments = {stage.run.experiment: stage for stage in design.problem.experiments}
    disturbed = {name for name, stage in experiments.items() if stage.run.injections or stage.run.spacecraft}
    tone_response = _simulate_quantities(design.campaign, set(experiments), jobs)
    update_progress(len(experiments) / (len(experiments) + len(disturbed)))
    without_tones = with_tones(design.campaign, dict.fromkeys(disturbed, ()))
    undriven = _simulate_quantities(without_tones, disturbed, jobs) if disturbed else {}
    ratios = {}
    for name, stage in experiments.items():
        # along x a static level is there from the first sample on; a rotating spacecraft settles
        response = {
            quantity: x - (undriven[name][quantity] if name in undriven else x[0])
            for quantity, x in tone_response[name].items()
        }
        ratios[name] = limits.limit_ratios(stage.run, stage.active_limits, response)
    return ratios


def _simulate_quantities(
    campaign: Campaign, experiments: Set[str], jobs: int | None
) -> dict[str, dict[str, Array]]:
    """Simulate the sysid runs of some experiments without noise; return the limited quantities of each."""
    noise_free = tuple(
        replace(e, noise=Noise(), plateau=(), n_noise_samples=0, sample_rate=FS)
        for e in campaign.experiments
        if e.name in experiments
    )
    plan = replace(campaign, experiments=noise_free, actuation=Actuation(), events=None)
    runs = {run.experiment: run for run in plan.runs}
    with tempfile.TemporaryDirectory() as folder:
        telemetries = read_all(simulate(plan, folder, jobs=jobs))
        return {t.experiment: limits.quantities(runs[t.experiment], dict(t.channels)) for t in telemetries}
