"""Identification: the FMUs of a campaign as a loop that is simulated with trial values of its parameters.

Nothing is estimated here. `fit.identification` asks for responses, and never sees an FMU.
"""

from lpfcosim.identification.origin import check
from lpfcosim.identification.parameters import Target, targets
from lpfcosim.identification.simulation import Simulation

__all__ = ["Simulation", "Target", "check", "targets"]
