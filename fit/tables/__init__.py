"""Tables: numbers in print, rows of estimates, and what telemetry and results look like in a notebook."""

from fit.tables.grids import Cell, Grid, Line, flagged, name_head, parameter_head
from fit.tables.lines import Lines, estimates
from fit.tables.parameters import LIMIT, Table, combination_text, signed, symbol

__all__ = [
    "LIMIT",
    "Cell",
    "Grid",
    "Line",
    "Lines",
    "Table",
    "combination_text",
    "estimates",
    "flagged",
    "name_head",
    "notebook",
    "parameter_head",
    "parameters",
    "signed",
    "symbol",
]
