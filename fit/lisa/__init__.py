"""One LISA spacecraft, calibrated by itself: its two test masses, compared with each other.

The observable and its signs are in `fit.model.lisa_dynamics`. Everything behind it is that of LISA
Pathfinder: whitening, fit, weak priors, warnings, results.
"""

from fit.lisa.calibration import calibrate_lisa, is_lisa, make_lisa_params
from fit.lisa.expected_fit import PlannedLisaExperiment, expected_lisa_fit
from fit.lisa.experiment import LisaExperiment, LisaRun

__all__ = [
    "LisaExperiment",
    "LisaRun",
    "PlannedLisaExperiment",
    "calibrate_lisa",
    "expected_lisa_fit",
    "is_lisa",
    "make_lisa_params",
]
