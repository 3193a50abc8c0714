"""Export: the closed loop for other tools, as SSP 1.0."""
