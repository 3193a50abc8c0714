"""Signals: what is injected into a run, streams of noise, events, and the low-pass below 10 Hz.

Which noise there is depends on the spacecraft model of the run, so `lpfcosim.models` starts the streams.
"""

from lpfcosim.signals.injections import commanded, injected
from lpfcosim.signals.noise import Noise, Source, Weights, flicker, red, white
from lpfcosim.signals.seeding import generator
