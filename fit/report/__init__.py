"""The report: one page made from telemetry and results, with its figures.

It decides what is shown, where, and with what words. What a figure consists of says `fit.figures`; in the
page uPlot draws it. For print, and one by one for a notebook (`plot`), `fit.plotting` does.
"""

__all__ = ["page", "plot"]
