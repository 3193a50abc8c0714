"""Figures: what is drawn, each with the numbers it draws, and its files. The only user of matplotlib."""

from fit.figures.drawings import Drawing, drawing
from fit.figures.files import drawn, svg

__all__ = [
    "Drawing",
    "delta_g",
    "drawing",
    "drawn",
    "files",
    "mcmc",
    "mission",
    "montecarlo",
    "motion",
    "runs",
    "svg",
]
