"""Modelica to FMU: flatten, evaluate, sort, print C, describe, build.

Every model of the package ``fmus/LISAPathfinder`` takes the same path; nothing here knows any of them.
A construct that this path does not carry over faithfully is refused with file, line and name.
"""

from lpfcosim.modelica.build import engine_library

__all__ = ["build", "engine_library"]
