"""Design of experiments: the injections that determine the parameters best within the limits of a mission.

A convex programme finds the best power by frequency, and a bound that no design goes below. Tones are then
sought that come near to it. `FitModel` forecasts what a fit will determine.
"""

from lpfcosim.experiment_design.designing import design
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.robustness import Robustness, robustness
from lpfcosim.experiment_design.search import Design, Told
from lpfcosim.experiment_design.sought import with_tones
from lpfcosim.experiment_design.telling import telling
from lpfcosim.experiment_design.writing import text

__all__ = [
    "Design",
    "FitModel",
    "Robustness",
    "Told",
    "design",
    "limits",
    "robustness",
    "telling",
    "text",
    "with_tones",
]
