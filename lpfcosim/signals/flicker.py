"""Noise whose ASD rises as f^-1/2 towards low frequencies: the sum of white noise and three red ones."""

import math

from lpfcosim.signals.noise import CORNER, Source

KNEE = 1e-3  # Hz, below which it rises (choice)
# Corner [Hz] of each red part and its PSD there, relative to that of f^-1/2; then the PSD of the white part.
# By least largest deviation: the ASD is within 6 % of level max(1, (KNEE/f)^1/2) from 10 uHz up, and flat
# below CORNER.
_RED = ((CORNER, 1.977), (math.sqrt(CORNER * 0.1268 * KNEE), 0.996), (0.1268 * KNEE, 1.709))
_WHITE = 0.8906


def flicker(name: str, level: float) -> tuple[Source, ...]:
    """Return noise of ASD ``level`` above the knee that rises as f^-1/2 below; none without a level."""
    if not level:
        return ()
    red = [
        Source(f"{name}_{i}", name, level * math.sqrt(size * KNEE * corner), corner)
        for i, (corner, size) in enumerate(_RED)
    ]
    return (Source(name, name, level * math.sqrt(_WHITE)), *red)
