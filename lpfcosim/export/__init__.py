"""Export: the closed loop for other tools, as SSP and as one FMU."""
