"""Design of experiments: the injections that determine the parameters best within the limits of a mission.

A convex programme finds the best power by frequency, and a bound that no design goes below. Tones are then
sought that come near to it. `FitModel` forecasts what a fit will determine.
"""

from lpfcosim.experiment_design.campaign_writer import campaign_text, is_design
from lpfcosim.experiment_design.design_problem import design_problem, with_tones
from lpfcosim.experiment_design.fit_model import FitModel
from lpfcosim.experiment_design.search import Design, search
