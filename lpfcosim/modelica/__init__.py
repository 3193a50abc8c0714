"""Modelica to FMU: flatten, evaluate, sort, print C, describe, build.

All models of the package ``fmus/LISAPathfinder`` take the same path; nothing here depends on one of them.
A construct that cannot be translated faithfully is refused with file, line and name.
"""

from lpfcosim.modelica.build import engine_library
