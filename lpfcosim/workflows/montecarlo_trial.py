"""One campaign of a Monte Carlo, in a worker process: simulated, and fitted."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fit.crosstalk import euler_fit
from fit.errors import CalibrationError
from fit.forecasting import coverage
from fit.parallel import one_blas_thread, serial
from fit.parameters import LISA as LISA_PARAMETERS
from fit.pipeline import calibrate
from fit.results import Results
from fit.settings import Settings
from fit.spacecraft import spacecraft_of
from fit.telemetry import Telemetry, read_all
from lpfcosim.campaign import Campaign, montecarlo
from lpfcosim.cosim import FmuLibraryCache, SimulationProgress
from lpfcosim.errors import RunError
from lpfcosim.execution import runner, telemetry_file
from lpfcosim.linear import ClosedLoop, spectral_simulation, stability
from lpfcosim.models import model_of
from lpfcosim.planned_experiments import telemetry_of
from lpfcosim.signals import generator
from lpfcosim.spacecraft import Run

Record = dict[str, Any]  # of one campaign, as the log holds it


class SpectralSimulator:
    """Draws telemetry of runs from the spectra of the linear closed loop.

    The spectra of a run are computed once, and again only if more than its seed has changed.
    """

    def __init__(self) -> None:
        self._simulations: dict[str, tuple[Run, spectral_simulation.Simulation, Mapping[str, float]]] = {}

    def draw(self, run: Run, rng: np.random.Generator) -> Telemetry:
        """Return telemetry of a run at 1 Hz.

        Raises
        ------
        RunError
            If a command reaches its limit.
        """
        simulation, limits = self._simulation(run)
        channels = simulation.record(rng)
        for name, limit in limits.items():
            if name in channels and np.nanmax(np.abs(channels[name])) >= limit:
                raise RunError(f"{run.name}: {name} reaches its limit, which only the FMUs know")
        return telemetry_of(run, channels)

    def _simulation(self, run: Run) -> tuple[spectral_simulation.Simulation, Mapping[str, float]]:
        """Return the simulation of a run and the limits of its commands."""
        key = run if run.events else replace(run, seed=0)  # the seed counts for glitches and gaps alone
        previous, *simulation = self._simulations.pop(run.name, (None, None, {}))
        if previous != key:
            _, latest, _ = next(reversed(self._simulations.values()), (None, None, {}))
            simulation = [
                spectral_simulation.Simulation(run, channels_of_fit(run), latest),
                ClosedLoop(run).limits,
            ]
        self._simulations[run.name] = (key, *simulation)
        return self._simulations[run.name][1:]


@dataclass(frozen=True)
class MonteCarloTask:
    """What all campaigns of a Monte Carlo have in common.

    Attributes
    ----------
    plan : Campaign
        Each campaign has its own number and seed, and its own truths if `redraw`.
    fit_settings : Settings
        Of the fit.
    redraw : bool
        Whether every campaign has truths of its own.
    fmus : mapping of str to Path
        By model; without any, telemetry is drawn from spectra.
    """

    plan: Campaign
    fit_settings: Settings
    redraw: bool
    fmus: Mapping[str, Path] = field(default_factory=dict)
    _simulator: SpectralSimulator = field(default_factory=SpectralSimulator, compare=False, repr=False)

    @one_blas_thread
    def run(self, number: int, progress: SimulationProgress) -> Record:
        """Simulate and fit a campaign; the same results whatever the process and what came before in it.

        Parameters
        ----------
        number : int
            Of the campaign.
        progress : SimulationProgress
            Of the FMUs.

        Returns
        -------
        dict
            With ``estimates`` (difference from the truth and sigma, by parameter), or with ``failed``, the
            reason.
        """
        plan = misaligned(montecarlo.numbered(self.plan, number, redraw=self.redraw))
        try:
            with serial():  # one process for each processor is faster than threads
                results = self._with_fmus(plan, progress) if self.fmus else self._from_spectra(plan)
        except (CalibrationError, RunError) as error:
            return {"number": number, "failed": str(error)}
        if results.joint and results.joint.unsound:
            return {"number": number, "failed": results.joint.unsound[0].message}
        truth = {"truth": telemetry_file.truth(plan.runs[0])} if self.redraw else {}
        return {"number": number, "estimates": coverage.estimates(results), **truth}

    def _with_fmus(self, plan: Campaign, progress: SimulationProgress) -> Results:
        with tempfile.TemporaryDirectory(prefix="lpfcosim-") as name:
            folder = Path(name)
            with FmuLibraryCache() as libraries:
                for run in plan.runs:
                    path = folder / f"{run.name}.h5"
                    runner.write_telemetry(run, self.fmus, path, {}, progress=progress, libraries=libraries)
                    progress.set_idle()
            telemetries = read_all(sorted(folder.glob("*.h5")), trusted=True)
            return coverage.with_truth(calibrate(telemetries, self.fit_settings), telemetries)

    def _from_spectra(self, plan: Campaign) -> Results:
        if self.redraw:
            stability.check(*plan.runs)  # other truths may not be stable where the campaign's are
        telemetries = [
            self._simulator.draw(run, generator(plan.seed, run.name, "spectra")) for run in plan.runs
        ]
        results = calibrate(telemetries, self.fit_settings)
        truths = {run.name: telemetry_file.truth(run) for run in plan.runs}
        return coverage.with_truth(results, telemetries, truths)


def misaligned(plan: Campaign) -> Campaign:
    """Return a plan with axes of LISA as the fit assumes them: about one truth pulls scatter too little."""
    random, stated = generator(plan.seed, "axes"), plan.fit.get("parameters", {})
    known = plan.model.values(plan.runs[0])
    assumed = [p for p in LISA_PARAMETERS.values() if p.assumed_sigma and p.name in known]
    axes = {p.name: random.normal(p.value, p.assumed_sigma) for p in assumed if p.name not in stated}
    return replace(plan, truth={**plan.truth, **axes})


def channels_of_fit(run: Run) -> list[str]:
    """Return the recorded channels that a fit reads; the star tracker only in long noise runs."""
    record = model_of(run).record
    spacecraft = spacecraft_of(telemetry_of(run, dict.fromkeys(record, np.zeros(1))))
    is_inertial = run.kind == "noise" and run.n_samples / run.fs >= euler_fit.MIN_DURATION
    names = (*spacecraft.needed, *(spacecraft.attitude if is_inertial else ()))
    return [name for name in names if name in record]
