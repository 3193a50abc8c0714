"""Tables: numbers in print, and what telemetry and results look like in a notebook."""

from fit.tables.parameters import LIMIT, Number, Table, signed, symbol

__all__ = ["LIMIT", "Number", "Table", "notebook", "parameters", "signed", "symbol"]
