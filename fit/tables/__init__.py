"""Tables, and numbers in print: for a terminal, a notebook, LaTeX and the page."""

from fit.tables.numbers import (
    FIXED,
    WITHHELD,
    combination_text,
    latex_symbol,
    latex_text,
    latex_unit,
    latex_value,
    measurement,
    power_of_ten,
    prose,
    rounded,
    sigma_text,
    signed,
    symbol,
    unit_text,
    value_text,
    withheld,
)
from fit.tables.table import (
    LIMIT,
    Cell,
    Table,
    highlight,
    html_list,
    name_head,
    pull_text,
)
