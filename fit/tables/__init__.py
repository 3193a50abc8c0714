"""Tables: numbers in print, rows of estimates, and what telemetry and results look like in a notebook."""

from fit.tables.lines import Lines, estimates
from fit.tables.parameters import LIMIT, Number, Table, signed, symbol

__all__ = ["LIMIT", "Lines", "Number", "Table", "estimates", "notebook", "parameters", "signed", "symbol"]
