"""Spacecraft models: which Modelica models a run joins, and what it gives them.

A `SpacecraftModel` holds all that depends on the degrees of freedom of a run: its models, their parameters
and truths, its noise. `Run.spacecraft`, what a run has in addition to the x axis, chooses it by its type, and
a spacecraft other than LISA Pathfinder by its name. To add one, write a module here that makes it, and
register it below.
"""

from lpfcosim.models import lisa, one_axis, six_dof
from lpfcosim.models.spacecraft_model import (
    DELTA_G,
    SpacecraftModel,
    fmu_names,
    model_of,
    register,
    registered,
)

register(one_axis.MODEL, six_dof.MODEL, lisa.MODEL, lisa.FALL_BACK)

__all__ = ["DELTA_G", "SpacecraftModel", "fmu_names", "model_of", "register", "registered", "stimuli"]
