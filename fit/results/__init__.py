"""The results of a calibration: what they hold, how they came about, and their JSON form."""

from fit.results.estimates import FIXED, QUANTILES, WITHHELD, Diagnostics, Estimate, Stiffness
from fit.results.provenance import Provenance
from fit.results.results import (
    Fit,
    Results,
    check_frame,
    load,
    sound_joint,
    write,
)

__all__ = [
    "FIXED",
    "QUANTILES",
    "WITHHELD",
    "Diagnostics",
    "Estimate",
    "Fit",
    "Provenance",
    "Results",
    "Stiffness",
    "check_frame",
    "load",
    "sound_joint",
    "write",
]
