"""Design of experiments: which injections tell most within the limits that a mission has.

A convex programme finds the power that tells most by frequency, and a bound that no design goes below. Tones
are then sought that come near to it. What a fit will know is told by `Foresight`, which others hand in.
"""

from lpfcosim.design.calibration import Calibration
from lpfcosim.design.checking import CLOSE, through_fmus
from lpfcosim.design.designing import design
from lpfcosim.design.robustness import Robustness, robustness
from lpfcosim.design.search import Design, Told
from lpfcosim.design.sought import Foresight
from lpfcosim.design.telling import telling
from lpfcosim.design.writing import text

__all__ = [
    "CLOSE",
    "Calibration",
    "Design",
    "Foresight",
    "Robustness",
    "Told",
    "design",
    "robustness",
    "telling",
    "text",
    "through_fmus",
]
