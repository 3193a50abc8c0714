"""Signals: what is injected into a run, streams of noise, events, and the low-pass below 10 Hz.

Which noise there is depends on the world of the run, so `lpfcosim.worlds` starts the streams.
"""

from lpfcosim.signals.drawing import Drawing, Fill, plain
from lpfcosim.signals.flicker import flicker
from lpfcosim.signals.injections import TARGETS, commanded, injected
from lpfcosim.signals.noise import CORNER, Noise, Shares, Source, tail
from lpfcosim.signals.wander import Wander

__all__ = [
    "CORNER",
    "TARGETS",
    "Drawing",
    "Fill",
    "Noise",
    "Shares",
    "Source",
    "Wander",
    "commanded",
    "decimation",
    "events",
    "flicker",
    "injected",
    "plain",
    "tail",
]
