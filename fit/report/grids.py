"""Sections of the report that hold other tables than those of parameters."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from fit.figures import Drawing
from fit.paper import Parameter
from fit.results import Fit, Results
from fit.tables import Number
from fit.tables import parameters as tables
from fit.telemetry import Telemetry

Cell = Number | str | None


@dataclass(frozen=True)
class Line:
    """A line of a table: a number with its sigma, a text, or nothing in every cell."""

    head: Markup
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes
    ----------
    about : str
        What it shows.
    head : tuple of str, length C + 1
        Over the heads of the lines, and over their cells.
    lines : tuple of Line
        With C cells each.
    """

    about: str
    head: tuple[str, ...]
    lines: tuple[Line, ...]

    @property
    def wide(self) -> tuple[bool, ...]:
        """Tell which columns hold numbers with their sigma."""
        return tuple(
            any(isinstance(line.cells[i], Number) for line in self.lines) for i in range(len(self.head) - 1)
        )


@dataclass(frozen=True)
class Part:
    """A section of the page: words, tables, figures beside or `below` them, and a matrix to unfold."""

    anchor: str
    title: str
    text: str = ""
    grids: tuple[Grid, ...] = ()
    drawings: tuple[Drawing, ...] = ()
    below: bool = False
    correlation: tables.Correlation | None = None


def parameter_head(parameter: Parameter, of: str = "") -> tuple[Markup, int]:
    """Return the head of a line on a parameter, and the power of ten its numbers share."""
    exponent = tables.power_of_ten(parameter.value)
    unit = tables.unit_text(parameter.unit, exponent)
    return name_head(Markup("{}{}").format(Markup(parameter.html), of), parameter.name, unit), exponent


def name_head(symbol: Markup, name: str, unit: str = "") -> Markup:
    """Return the head of a line: symbol, name as in the files, and unit in print."""
    named = f"{name} [{unit}]" if unit else name
    return Markup("{}<code>{}</code><small>{}</small>").format(symbol, named, unit)


def flagged(text: str, bad: bool) -> str:
    """Return a text in the colour of what is wrong, where it is."""
    return Markup('<span class="off">{}</span>').format(text) if bad else text


def fitted_for(
    name: str, results: Results, telemetries: Sequence[Telemetry]
) -> Iterator[tuple[Telemetry, Fit]]:
    """Yield every sysid run whose experiment, fitted alone, determines a parameter, and that fit."""
    for run in telemetries:
        fit = results.experiments.get(run.experiment)
        if run.kind == "sysid" and fit and name in fit.parameters:
            yield run, fit
