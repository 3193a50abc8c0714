"""Figures for print: matplotlib draws the records of `fit.figures`, written as SVG, PDF and CSV.

The only user of matplotlib, imported when a figure is requested.
"""

from fit.plotting.files import Plot, PlotAxes, draw, write
