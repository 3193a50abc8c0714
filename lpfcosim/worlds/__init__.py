"""Worlds: "along x or the whole spacecraft?", answered once.

A `World` holds all that depends on which degrees of freedom a run has: its components and what is recorded,
their parameters, units and truths, its noise, limits, reference plant and loops. What a run has beside the x
axis, `Run.spacecraft`, chooses its world. Another world is a module here that makes one, its name below, and
the class of what such a run has.
"""

from lpfcosim.worlds import along_x, drive, whole
from lpfcosim.worlds.loop import System, on_circle
from lpfcosim.worlds.world import World, of, register

register(along_x.WORLD, whole.WORLD)

__all__ = ["System", "World", "drive", "of", "on_circle", "register"]
