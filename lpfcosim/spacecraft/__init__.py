"""The spacecraft: one run of it, with all that a simulation needs, as frozen records in SI units."""

from lpfcosim.spacecraft.actuation import ARM, LARGEST_PULL, Actuation, largest_pull
from lpfcosim.spacecraft.control import DRAG_FREE, SUSPENSION, Controller, Lead
from lpfcosim.spacecraft.electrodes import ETA_PER_X, PHI_PER_X
from lpfcosim.spacecraft.events import Events
from lpfcosim.spacecraft.parameters import FS, LONGEST_DELAY, M_TM, READ_OUT_RANGE, H
from lpfcosim.spacecraft.run import (
    SCATTERED,
    Authority,
    HalfCosine,
    Injection,
    Kind,
    Noise,
    Replacement,
    Run,
    Sine,
    TaperedSine,
    Truth,
)
from lpfcosim.spacecraft.spacecraft import Spacecraft
from lpfcosim.spacecraft.thrusters import EIGHT_NOZZLES, Layout

__all__ = [
    "ARM",
    "DRAG_FREE",
    "EIGHT_NOZZLES",
    "ETA_PER_X",
    "FS",
    "LARGEST_PULL",
    "LONGEST_DELAY",
    "M_TM",
    "PHI_PER_X",
    "READ_OUT_RANGE",
    "SCATTERED",
    "SUSPENSION",
    "Actuation",
    "Authority",
    "Controller",
    "Events",
    "H",
    "HalfCosine",
    "Injection",
    "Kind",
    "Layout",
    "Lead",
    "Noise",
    "Replacement",
    "Run",
    "Sine",
    "Spacecraft",
    "TaperedSine",
    "Truth",
    "largest_pull",
]
