"""Three spacecraft as a constellation: the file of their motion, and lisainstrument moved by it.

The attitude of a LISA spacecraft is sensed locally, so that the three move independently: each is a run by
itself, and the constellation begins where their telemetry ends.
"""

from lpfcosim.constellation.jitter import ASSEMBLIES, SERIES, Jitter, join, read_jitter, write_jitter
from lpfcosim.constellation.lisainstrument_adapter import simulate_measurements

__all__ = [
    "ASSEMBLIES",
    "SERIES",
    "Jitter",
    "join",
    "read_jitter",
    "simulate_measurements",
    "write_jitter",
]
