"""Export: the closed loop for other tools, as SSP and as one FMU."""

__all__ = ["container", "ssp"]
