"""Identification: the FMUs of a campaign as a loop that is simulated with trial values of its parameters.

Nothing is estimated here. `fit.identification` asks for responses, and never sees an FMU.
"""

from lpfcosim.identify.origin import check
from lpfcosim.identify.parameters import Target, targets
from lpfcosim.identify.simulation import Simulation

__all__ = ["Simulation", "Target", "check", "targets"]
