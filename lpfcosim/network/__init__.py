"""The network: which FMU feeds which, and in which order they step."""

from lpfcosim.network.wiring import Component, check_feedthrough, endpoint

__all__ = ["Component", "check_feedthrough", "endpoint", "network"]
