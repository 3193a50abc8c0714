"""Co-simulation: FMU archives, their place in the loop, and the master that steps them."""

from lpfcosim.cosim.interface import Interface
from lpfcosim.cosim.master import Engine, Where
from lpfcosim.cosim.placement import interfaces

__all__ = ["Engine", "Interface", "Where", "checks", "interfaces", "master", "placement"]
