"""The network: which FMU feeds which, and in which order they step."""
