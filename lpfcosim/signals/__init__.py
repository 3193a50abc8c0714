"""Signals: what is injected into a run, streams of noise, and the low-pass below 10 Hz.

Which noise there is depends on the world of the run, so `lpfcosim.worlds` starts the streams.
"""

from lpfcosim.signals.injections import TARGETS, injected
from lpfcosim.signals.noise import CORNER, Noise, Source, tail

__all__ = ["CORNER", "TARGETS", "Noise", "Source", "decimation", "injected", "tail"]
