"""Identification: the closed loop of FMUs, simulated with trial values of its parameters.

Nothing is estimated here: `fit.identification` calls the response, and knows no FMU.
"""

from lpfcosim.identification.closed_loop_response import ClosedLoopResponse, run_of
from lpfcosim.identification.parameters import Target, targets
