"""The model: the equation of motion, what experiments share of its parameters, rotation, inertial forces.

The only room with signs.
"""

from fit.model.calibrated import Dynamics, dynamics_of
from fit.model.dynamics import Columns
from fit.model.sharing import Sharing
from fit.model.stretches import Grid, Stretch, cut, differentiated, grid, reduced

__all__ = [
    "Columns",
    "Dynamics",
    "Grid",
    "Sharing",
    "Stretch",
    "cut",
    "differentiated",
    "dynamics",
    "dynamics_of",
    "grid",
    "rate",
    "reduced",
    "rotation",
]
