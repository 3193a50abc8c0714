"""The model: the equation of motion, what experiments share of its parameters, rotation, inertial forces.

The only room with signs.
"""
