"""Figures as records: what is drawn, each with the numbers it draws and what its axes measure.

Nothing here draws. `fit.plotting` does so for print, `fit.report` for the page.
"""

from fit.figures.charts import Axis, Chart, Curve, Note, Panel, Points, Span
from fit.figures.colours import COLOURS
