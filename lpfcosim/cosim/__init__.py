"""Co-simulation: FMU archives, their place in the loop, and the master that steps them."""
