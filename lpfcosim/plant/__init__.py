"""The reference plant: the closed loop without FMUs, in time and in frequency, and what drives it."""

from lpfcosim.plant import (
    decimation,
    margins,
    planning,
    reference,
    saturation,
    signals,
    spectral,
    stability,
    whole,
)

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
