"""Figures: what is drawn, each with the numbers it draws, what its axes measure, and its files.

The only user of matplotlib.
"""

from fit.figures.files import Drawing, Plot, drawing, drawn, save, svg, write
from fit.figures.style import COLOURS

__all__ = [
    "COLOURS",
    "Drawing",
    "Plot",
    "drawing",
    "drawn",
    "mission",
    "motion",
    "runs",
    "save",
    "studies",
    "svg",
    "write",
]
