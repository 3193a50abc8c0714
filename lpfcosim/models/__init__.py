"""Spacecraft models: which Modelica models a run joins, and what it gives them.

A `SpacecraftModel` holds all that depends on the degrees of freedom of a run: its models, their parameters
and truths, its noise. `Run.spacecraft` chooses it by its key. To add one, write a module here that makes it,
and register it below.
"""

from lpfcosim.models import lisa, one_axis, six_dof
from lpfcosim.models.measurement_range import check_measurement_range
from lpfcosim.models.one_axis import ELECTRODES, SCATTERED, STIFFNESS
from lpfcosim.models.spacecraft_model import (
    DELTA_G,
    SpacecraftModel,
    fmu_names,
    model_of,
    register,
    registered,
)

register(one_axis.MODEL, six_dof.MODEL, lisa.MODEL, lisa.FALL_BACK)
