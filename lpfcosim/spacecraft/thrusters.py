"""The layout of the thrusters: the force and torque of each nozzle."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _eight_nozzles() -> Array:
    """Return force [1] and torque [m] on the spacecraft per thrust of each of n nozzles, shape (6, n).

    They are four pairs on two opposite sides, below the solar panel; geometry is a choice.

    The pairs stand 1 m from the axis through the centre of mass, 0.25 m above it towards the Sun, 30, 85, 210
    and 265 degrees from x. The nozzles of a pair push inwards, 25 degrees to either side, and 20 degrees
    towards the Sun, whose pressure all of them balance together.
    """
    aside, up = math.radians(25), math.radians(20)
    places, directions = [], []
    for degrees in (30, 85, 210, 265):
        azimuth = math.radians(degrees)
        for side in (-aside, aside):
            places.append((math.cos(azimuth), math.sin(azimuth), 0.25))
            inwards = azimuth + math.pi + side
            level = math.cos(up)
            directions.append((level * math.cos(inwards), level * math.sin(inwards), math.sin(up)))
    return np.vstack([np.transpose(directions), np.cross(places, directions).T])


#: Shape (6, 8), see `_eight_nozzles`.
EIGHT_NOZZLES = _eight_nozzles()
