"""Figures for print: matplotlib draws what `fit.figures` describes, and writes it as SVG, PDF and CSV.

The only user of matplotlib, which takes its time: nothing comes here unless somebody asks for it.
"""

from fit.plotting.files import Plot, drawn, save, svg, write

__all__ = ["Plot", "drawn", "save", "studies", "svg", "write"]
