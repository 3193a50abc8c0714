"""Co-simulation: FMU archives, their place in the loop, and the master that steps them.

It treats FMUs of any origin alike. The loop itself is compiled C (`engine.c`); a plain one in FMPy gives
the same bits.
"""

from lpfcosim.cosim.interface import Interface, describe, nonconformity, read
from lpfcosim.cosim.loaded import Shelf
from lpfcosim.cosim.master import Engine, Where
from lpfcosim.cosim.placement import driver, interfaces, interfaces_of_runs, warnings
from lpfcosim.cosim.slave import Slave
from lpfcosim.cosim.variables import REALS, Value

__all__ = [
    "REALS",
    "Engine",
    "Interface",
    "Shelf",
    "Slave",
    "Value",
    "Where",
    "archive",
    "checks",
    "compilation",
    "compiled",
    "describe",
    "driver",
    "interfaces",
    "interfaces_of_runs",
    "master",
    "nonconformity",
    "placement",
    "read",
    "warnings",
]
