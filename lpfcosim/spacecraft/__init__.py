"""The spacecraft: one run of it, with all that a simulation needs, as frozen records in SI units."""

from lpfcosim.spacecraft.control import DRAG_FREE, SUSPENSION, Controller, Lead
from lpfcosim.spacecraft.parameters import FS, M_TM, READ_OUT_RANGE, H
from lpfcosim.spacecraft.run import (
    Authority,
    Disturbed,
    HalfCosine,
    Injection,
    Kind,
    Model,
    Noise,
    Pulse,
    Replacement,
    Run,
    Sine,
    Target,
    Thrusters,
    Truth,
)
from lpfcosim.spacecraft.spacecraft import Spacecraft

__all__ = [
    "DRAG_FREE",
    "FS",
    "M_TM",
    "READ_OUT_RANGE",
    "SUSPENSION",
    "Authority",
    "Controller",
    "Disturbed",
    "H",
    "HalfCosine",
    "Injection",
    "Kind",
    "Lead",
    "Model",
    "Noise",
    "Pulse",
    "Replacement",
    "Run",
    "Sine",
    "Spacecraft",
    "Target",
    "Thrusters",
    "Truth",
]
