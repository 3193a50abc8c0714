"""Figures: what is drawn, each with the numbers it draws, what its axes measure, and its files.

The only user of matplotlib.
"""

from fit.figures.files import COLOURS, Drawing, Plot, drawing, drawn, save, svg, write

__all__ = [
    "COLOURS",
    "Drawing",
    "Plot",
    "delta_g",
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
