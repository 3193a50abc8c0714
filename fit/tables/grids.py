"""Tables of the page other than those of parameters: cells with numbers and their sigmas."""

from dataclasses import dataclass

from markupsafe import Markup

from fit.parameters import Parameter
from fit.tables.parameters import Number, power_of_ten, unit_text

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
    caption : str
        What it shows.
    head : tuple of str, length C + 1
        Over the heads of the lines, and over their cells.
    lines : tuple of Line
        With C cells each.
    """

    caption: str
    head: tuple[str, ...]
    lines: tuple[Line, ...]

    @property
    def wide(self) -> tuple[bool, ...]:
        """Tell which columns hold numbers with their sigma."""
        return tuple(
            any(isinstance(line.cells[i], Number) for line in self.lines) for i in range(len(self.head) - 1)
        )


def parameter_head(parameter: Parameter, suffix: str = "") -> tuple[Markup, int]:
    """Return the head of a line on a parameter, and the power of ten its numbers share."""
    exponent = power_of_ten(parameter.value)
    unit = unit_text(parameter.unit, exponent)
    return name_head(Markup("{}{}").format(Markup(parameter.html), suffix), parameter.name, unit), exponent


def name_head(symbol: Markup, name: str, unit: str = "") -> Markup:
    """Return the head of a line: symbol, name as in the files, and unit in print."""
    named = f"{name} [{unit}]" if unit else name
    return Markup("{}<code>{}</code><small>{}</small>").format(symbol, named, unit)


def flagged(text: str, bad: bool) -> str:
    """Return a text in the colour of what is wrong, where it is."""
    return Markup('<span class="off">{}</span>').format(text) if bad else text
