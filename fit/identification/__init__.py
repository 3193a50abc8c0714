"""Identification: parameters of a loop that somebody else simulates, estimated with the weighing of the fit.

What was measured and is not to be predicted is imposed on the simulated loop; what is left of o_12 is turned
into the force that made it, and weighed as a residual of the fit is. Where the loop comes from, nobody here
knows: it is a `Loop`.
"""

from fit.identification.identify import identify
from fit.identification.joint import make_params
from fit.identification.protocol import Free

__all__ = ["Free", "identify", "make_params"]
