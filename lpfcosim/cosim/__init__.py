"""Co-simulation: FMU archives, their place in the loop, and the algorithm that steps them.

It treats FMUs of any origin alike. The loop itself is compiled C (`engine.c`).
"""

from lpfcosim.cosim.co_simulation import SimulationProgress
from lpfcosim.cosim.fmu_instance import FmuLibraryCache
from lpfcosim.cosim.interface import (
    Interface,
    ignored_names,
    read_interfaces,
    read_interfaces_of_runs,
    warnings,
)
from lpfcosim.cosim.values import REALS, Value
