"""Design of experiments: the injections that determine the parameters best within the limits of a mission.

A convex programme finds the best power by frequency, and a bound that no design goes below. Tones are then
sought that come near to it. `FitModel` forecasts what a fit will determine.
"""

from lpfcosim.experiment_design.campaign_writer import (
    TONES,
    campaign_text,
    extending_text,
    is_design,
    written_injections,
)
from lpfcosim.experiment_design.design_problem import with_tones
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.information_spectrum import information_spectrum
from lpfcosim.experiment_design.local_tones import LocalDesign, design_local_tones
from lpfcosim.experiment_design.manoeuvre import Manoeuvre, design_manoeuvre
from lpfcosim.experiment_design.optimize import design
from lpfcosim.experiment_design.robustness import Robustness, robustness
from lpfcosim.experiment_design.search import Design, SearchProgress

__all__ = [
    "TONES",
    "Design",
    "FitModel",
    "LocalDesign",
    "Manoeuvre",
    "Robustness",
    "SearchProgress",
    "campaign_text",
    "design",
    "design_local_tones",
    "design_manoeuvre",
    "extending_text",
    "information_spectrum",
    "is_design",
    "limits",
    "robustness",
    "with_tones",
    "written_injections",
]
