"""Runs along x through the reference plant, and campaigns from the equations of their models."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from lpfcosim.execution import runner
from lpfcosim.models import stimuli
from tests.oracles import reference_plant


@dataclass(frozen=True)
class Pulse:
    """A stray acceleration g_1 or g_2 [m s^-2], amplitude sin^2(pi (t - start) / duration)."""

    into: str
    amplitude: float
    start: float
    duration: float


def simulate_equations(plan, folder):
    """Simulate a campaign in this process, which takes no time to start; return the files of its runs."""
    with ThreadPoolExecutor(1) as executor:
        simulated = runner.simulate(plan, folder, {}, runner.RunOptions(executor=executor))
    return list(simulated.files.values())


def simulate_reference(run, pulses=()):
    """Return the channels of a run, driven by its injections, its noise and stray accelerations."""
    signals = stimuli.stimuli(run)
    for pulse in pulses:
        phase = (run.time - pulse.start) / pulse.duration
        shape = np.where((phase > 0) & (phase < 1), np.sin(np.pi * phase) ** 2, 0.0)
        signals[pulse.into] = signals[pulse.into] + pulse.amplitude * shape
    return reference_plant.simulate(run, signals)
