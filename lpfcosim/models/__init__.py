"""Worlds: the one place that tells a simulation along x from one of the whole spacecraft.

A `World` holds all that depends on the degrees of freedom of a run: its components and what is recorded,
their parameters, units and truths, its noise, limits, reference plant and loops. `Run.spacecraft`, what a
run has beside the x axis, chooses the world by its type. To add a world, write a module here that makes it,
and register it below.
"""

from lpfcosim.models import along_x, electrodes, whole
from lpfcosim.models.loop import System, on_circle
from lpfcosim.models.world import register, world_of

register(along_x.WORLD, whole.WORLD)

__all__ = ["System", "drive", "electrodes", "on_circle", "world_of"]
