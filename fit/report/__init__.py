"""The report: one page made from telemetry and results, with its figures.

It selects and arranges tables, figures and text. The records of figures are in `fit.figures`; uPlot draws
them in the page, and `fit.plotting` for print and, one by one, for a notebook (`plot`).
"""
