"""Tables: numbers in print, rows of estimates, and the display of telemetry and results in a notebook."""

from fit.tables.latex import latex_symbol
from fit.tables.numbers import (
    Measurement,
    ascii_value,
    combination_text,
    concise,
    estimate_text,
    fit_estimate,
    measurement,
    prose,
    signed,
    symbol,
    unit_text,
)
from fit.tables.parameters import ParameterTable, estimates, parameter_table
from fit.tables.table import LIMIT, Cell, Table, highlight, name_head, parameter_head, pull_text

__all__ = [
    "LIMIT",
    "Cell",
    "Measurement",
    "ParameterTable",
    "Table",
    "ascii_value",
    "combination_text",
    "concise",
    "estimate_text",
    "estimates",
    "fit_estimate",
    "highlight",
    "latex",
    "latex_symbol",
    "measurement",
    "name_head",
    "notebook",
    "parameter_head",
    "parameter_table",
    "prose",
    "pull_text",
    "signed",
    "symbol",
    "unit_text",
]
