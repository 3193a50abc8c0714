"""Tilt-to-length coupling of LISA: 24 coefficients from Michelson variables and wavefront sensing.

The angles of the six assemblies change the lengths of the beams that they receive and emit. TDI delays and
combines these lengths; `michelson` states how, with all signs.
"""

from fit.tilt_to_length import michelson
from fit.tilt_to_length.coefficients import COEFFICIENTS, NAMES
from fit.tilt_to_length.expected_sigmas import expected_sigmas
from fit.tilt_to_length.measurements import Measurements, read_measurements, write_measurements
from fit.tilt_to_length.subtraction import subtraction_spectra
from fit.tilt_to_length.ttl_fit import make_params
