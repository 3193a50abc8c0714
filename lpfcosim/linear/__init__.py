"""The closed loop in the frequency domain, the same for every world: stability, margins, response, spectra.

Nothing here steps an FMU. The reference plants themselves are in `lpfcosim.models`.
"""

__all__ = ["margins", "planning", "saturation", "spectral", "stability"]
