"""Co-simulation: FMU archives, their place in the loop, and the algorithm that steps them.

It treats FMUs of any origin alike. The loop itself is compiled C (`engine.c`).
"""

from lpfcosim.cosim.co_simulation import SimulationProgress
from lpfcosim.cosim.compatibility import read_interfaces, read_interfaces_of_runs, warnings
from lpfcosim.cosim.fmu_library import FmuLibraryCache
from lpfcosim.cosim.interface import Interface, describe, nonconformity, read
from lpfcosim.cosim.variables import REALS, Value

__all__ = [
    "REALS",
    "FmuLibraryCache",
    "Interface",
    "SimulationProgress",
    "Value",
    "archive",
    "checks",
    "co_simulation",
    "compatibility",
    "compilation",
    "describe",
    "nonconformity",
    "read",
    "read_interfaces",
    "read_interfaces_of_runs",
    "warnings",
]
