"""One campaign of a Monte Carlo, simulated and fitted: what processes and workers of a cluster do."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import fit.errors
from fit.estimate import pulls
from fit.model import dynamics
from fit.pipeline import calibrate
from fit.results import Results
from fit.settings import Settings
from fit.telemetry import Telemetry, read_all
from lpfcosim import worlds
from lpfcosim.campaign import campaign as campaigns
from lpfcosim.campaign import montecarlo
from lpfcosim.cli.study import in_memory
from lpfcosim.errors import LpfcosimError, RunError
from lpfcosim.plant import spectral, stability
from lpfcosim.running import runner, telemetry
from lpfcosim.spacecraft import Run

Line = dict[str, Any]  # what is kept of one campaign


@dataclass(frozen=True)
class Work:
    """What all campaigns have in common.

    Attributes
    ----------
    plan : Campaign
        Of number and seed, and of truths if `redraw`, it gets others.
    chosen : Settings
        Of the fit.
    redraw : bool
        Whether every campaign has truths of its own.
    """

    plan: campaigns.Campaign
    chosen: Settings
    redraw: bool


def trial(work: Work, number: int, fmus: Mapping[str, Path]) -> Line:
    """Simulate campaign `number`, through FMUs if there are any, and fit it.

    The same comes out in whatever process, and whatever came before in it.
    """
    plan = montecarlo.numbered(work.plan, number, redraw=work.redraw)
    try:
        results = _through_fmus(plan, work.chosen, fmus) if fmus else _from_spectra(plan, number, work)
    except (fit.errors.CalibrationError, LpfcosimError) as error:
        return {"number": number, "failed": str(error)}
    if results.joint and results.joint.unsound:
        return {"number": number, "failed": results.joint.unsound[0].message}
    drawn = {"truth": telemetry.truth(plan.runs[0])} if work.redraw else {}
    return {"number": number, "estimates": pulls.estimates(results), **drawn}


def _through_fmus(plan: campaigns.Campaign, chosen: Settings, fmus: Mapping[str, Path]) -> Results:
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        for run in plan.runs:
            runner.record(run, fmus, Path(folder) / f"{run.name}.h5", {})
        telemetries = read_all([Path(folder)], own=True)
        return pulls.with_truth(calibrate(telemetries, chosen), telemetries)


def _from_spectra(plan: campaigns.Campaign, number: int, work: Work) -> Results:
    telemetries = [
        _drawn(run, np.random.default_rng([number, plan.seed, *run.name.encode()])) for run in plan.runs
    ]
    results = calibrate(telemetries, work.chosen)
    return pulls.with_truth(results, telemetries, {run.name: telemetry.truth(run) for run in plan.runs})


#: What the last campaign left, by run: made anew only if more than the seed is another.
_simulations: dict[str, tuple[Run, spectral.Simulation]] = {}


def _drawn(run: Run, generator: np.random.Generator) -> Telemetry:
    of_run, simulation = _simulations.get(run.name, (None, None))
    if of_run is None or simulation is None or of_run != replace(run, seed=of_run.seed):
        stability.check(run)  # other truths may not be stable where the campaign's are
        simulation = spectral.Simulation(run, _channels(run))
        _simulations[run.name] = (run, simulation)
    channels = simulation.record(generator)
    limit = run.authority.F_max_2 / run.m_tm
    if np.abs(channels["f_x_2"]).max() >= limit:
        raise RunError(f"{run.name}: f_x_2 reaches its limit, which only the FMUs know: add --fmus")
    return in_memory(run, channels)


def _channels(run: Run) -> list[str]:
    """Return what the joint fit reads of what is recorded."""
    of_means = (name for parts in dynamics.MEANS.values() for name in parts)
    return [*dynamics.CHANNELS, *(name for name in of_means if name in worlds.of(run).record)]
