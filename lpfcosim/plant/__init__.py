"""The reference plant: the closed loop without FMUs, in time and in frequency, and what drives it."""

__all__ = [
    "decimation",
    "margins",
    "planning",
    "reference",
    "saturation",
    "signals",
    "spectral",
    "stability",
    "whole",
]
