"""A design in the time domain: its runs without noise, stepped through the FMUs, beside their limits."""

import tempfile
from collections.abc import Callable, Set
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.telemetry import read_all
from lpfcosim import api
from lpfcosim.campaign import Campaign
from lpfcosim.design import limits
from lpfcosim.design.search import Design
from lpfcosim.design.sought import with_tones
from lpfcosim.spacecraft import FS, Actuation, Noise

CLOSE = 1e-3  # relative, by which a limit may be passed and still counts as kept

Array = NDArray[np.float64]


def through_fmus(
    design: Design, jobs: int | None, told: Callable[[float], None]
) -> dict[str, dict[str, float]]:
    """Return what every run reaches of its limits, by experiment and limit, stepped through the FMUs.

    `told` is told which share of the work is done.

    Raises
    ------
    RunError
        If a run fails.
    """
    stages = {stage.run.experiment: stage for stage in design.problem.stages}
    others = {name for name, stage in stages.items() if stage.run.injections or stage.run.spacecraft}
    moved = _stepped(design.campaign, set(stages), jobs)
    told(len(stages) / (len(stages) + len(others)))
    resting = _stepped(with_tones(design.campaign, dict.fromkeys(others, ())), others, jobs) if others else {}
    found = {}
    for name, stage in stages.items():
        # along x what a run holds steadily is there from its first sample on; a turning spacecraft settles
        of = {key: x - (resting[name][key] if name in resting else x[0]) for key, x in moved[name].items()}
        found[name] = limits.excess(stage.run, stage.bounds, of)
    return found


def _stepped(campaign: Campaign, wanted: Set[str], jobs: int | None) -> dict[str, dict[str, Array]]:
    """Step the sysid runs of some experiments without noise; return the `QUANTITIES` of each."""
    quiet = tuple(
        replace(e, noise=Noise(), plateau=(), n_noise_samples=0, sample_rate=FS)
        for e in campaign.experiments
        if e.name in wanted
    )
    plan = replace(campaign, experiments=quiet, actuation=Actuation(), events=None)
    runs = {run.experiment: run for run in plan.runs}
    with tempfile.TemporaryDirectory() as folder:
        files = api.simulate(plan, folder, jobs=jobs)
        found = read_all(files)
        return {t.experiment: limits.quantities(runs[t.experiment], dict(t.channels)) for t in found}
