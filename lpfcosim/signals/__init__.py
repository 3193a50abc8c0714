"""Signals: what is injected into a run, streams of noise, events, and the low-pass below 10 Hz.

Which noise there is depends on the spacecraft model of the run, so `lpfcosim.models` starts the streams.
"""

from lpfcosim.signals.flicker import flicker
from lpfcosim.signals.gain_drift import GainDrift
from lpfcosim.signals.injections import commanded, injected
from lpfcosim.signals.noise import CORNER, Noise, Source, Weights, red_noise

__all__ = [
    "CORNER",
    "GainDrift",
    "Noise",
    "Source",
    "Weights",
    "commanded",
    "decimation",
    "events",
    "flicker",
    "injected",
    "red_noise",
]
