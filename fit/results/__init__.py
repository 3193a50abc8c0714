"""The results of a calibration: what they hold, how they came about, and their JSON form."""

from fit.results.provenance import Provenance
from fit.results.results import (
    QUANTILES,
    WITHHELD,
    Diagnostics,
    Estimate,
    Fit,
    Results,
    Stiffness,
    check_frame,
    load,
    sound_joint,
    write,
)

__all__ = [
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
