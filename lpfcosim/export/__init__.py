"""Export: the closed loop for other tools, as SSP and as one FMU."""

from lpfcosim.export import container, ssp

__all__ = ["container", "ssp"]
