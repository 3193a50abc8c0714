"""Signals: what is injected into a run, streams of noise, events, and the low-pass below 10 Hz.

Which noise there is depends on the world of the run, so `lpfcosim.models` starts the streams.
"""

from lpfcosim.signals.autoregression import Recursion, autoregress
from lpfcosim.signals.flicker import flicker
from lpfcosim.signals.injections import TARGETS, commanded, injected
from lpfcosim.signals.noise import CORNER, Noise, Shares, Source, tail
from lpfcosim.signals.wander import Wander

__all__ = [
    "CORNER",
    "TARGETS",
    "Noise",
    "Recursion",
    "Shares",
    "Source",
    "Wander",
    "autoregress",
    "commanded",
    "decimation",
    "events",
    "flicker",
    "injected",
    "tail",
]
