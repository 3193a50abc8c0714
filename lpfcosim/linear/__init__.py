"""The closed loop from the equations of its models: simulation, stability, margins, response, spectra.

Nothing here steps an FMU.
"""

from lpfcosim.linear.closed_loop import ClosedLoop
from lpfcosim.linear.state_space import StateSpace
