"""Runs along x through the reference plant, driven by their injections, noise and stray accelerations."""

from dataclasses import dataclass

import numpy as np

from lpfcosim.models import stimuli
from tests.oracles import reference_plant


@dataclass(frozen=True)
class Pulse:
    """A stray acceleration g_1 or g_2 [m s^-2], amplitude sin^2(pi (t - start) / duration)."""

    into: str
    amplitude: float
    start: float
    duration: float


def simulate_reference(run, pulses=()):
    signals = stimuli.stimuli(run)
    for pulse in pulses:
        phase = (run.time - pulse.start) / pulse.duration
        shape = np.where((phase > 0) & (phase < 1), np.sin(np.pi * phase) ** 2, 0.0)
        signals[pulse.into] = signals[pulse.into] + pulse.amplitude * shape
    return reference_plant.simulate(run, signals)
