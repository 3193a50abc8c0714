"""The model: the equation of motion, what experiments share of its parameters, rotation, inertial forces.

The only room with signs.
"""

from fit.model.calibrated import Dynamics, dynamics_of
from fit.model.dynamics import Columns
from fit.model.equation import Delays, Equation, Range, Spacecraft
from fit.model.inertial_forces import BASELINE, separation
from fit.model.run_channels import RunChannels, reduce_channels
from fit.model.sharing import Sharing, run_values
