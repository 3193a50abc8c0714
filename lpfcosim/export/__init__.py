"""Export: the closed loop for other tools, as SSP 1.0 or as a single container FMU."""

__all__ = ["container", "ssp"]
