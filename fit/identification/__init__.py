"""Identification: parameters of a closed loop that is simulated by others, estimated as those of the fit.

The measured o_1 and f_x_1 drive the simulated loop. The residual of o_12 is converted to the force that
causes it and weighted as a residual of the fit. The simulation is an implementation of the protocol `Loop`.
"""

from fit.identification.identify import identify
from fit.identification.loop import FreeParameter
