"""The report: one page made from telemetry and results, with its figures.

It decides what is shown, where, and with what words. The figures themselves are drawn by `fit.figures`. A
notebook gets them one by one from `plot`.
"""

__all__ = ["page", "plot"]
