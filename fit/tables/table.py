"""A table as text, as an element of a notebook, and as the page shows it."""

from dataclasses import dataclass

from markupsafe import Markup

from fit.parameters import Parameter
from fit.tables.numbers import Measurement, signed, unit_text
from fit.units import power_of_ten

LIMIT = 4.0  # sigma, beyond which page and tables flag a difference

Cell = Measurement | str | None


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    head : tuple of str, length C
        Over the columns.
    rows : sequence of tuple, each of length C
        In every cell a number with its sigma, a text, or None.
    caption : str
        What it shows.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    @property
    def texts(self) -> list[list[str]]:
        """The cells as texts."""
        return [["" if cell is None else str(cell) for cell in row] for row in self.rows]

    def aligned(self) -> list[str]:
        """Return the lines of the table in letters of one width."""
        lines = [list(self.head), *self.texts]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return ["  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]

    def html(self, n_left: int) -> Markup:
        """Return an element of a notebook; all but the first `n_left` columns are aligned to the right."""

        def line(tag: str, cells: list[str]) -> Markup:
            cell = Markup(f'<{tag} style="text-align:{{}}">{{}}</{tag}>')
            sides = ("left" if i < n_left else "right" for i in range(len(cells)))
            return Markup("<tr>{}</tr>").format(Markup().join(map(cell.format, sides, cells)))

        body = [[cell if isinstance(cell, str) else str(cell or "") for cell in row] for row in self.rows]
        return Markup("<table><thead>{}</thead><tbody>{}</tbody></table>").format(
            line("th", list(self.head)), Markup().join(line("td", row) for row in body)
        )


def highlight(text: str, condition: bool) -> str:
    """Return a text, in the colour of errors if a condition holds."""
    return Markup('<span class="off">{}</span>').format(text) if condition else text


def pull_text(pull: float, decimals: int = 1) -> str:
    """Return a difference in units of its sigma, highlighted beyond the `LIMIT`."""
    return highlight(signed(pull, decimals), abs(pull) > LIMIT)


def parameter_head(parameter: Parameter, suffix: str = "") -> tuple[Markup, int]:
    """Return the head of a row on a parameter, and the power of ten its numbers share."""
    exponent = power_of_ten(parameter.value)
    unit = unit_text(parameter.unit, exponent)
    return name_head(Markup("{}{}").format(Markup(parameter.html), suffix), parameter.name, unit), exponent


def name_head(symbol: Markup, name: str, unit: str = "") -> Markup:
    """Return the head of a row: symbol, name as in the files, and unit in print."""
    label = f"{name} [{unit}]" if unit else name
    return Markup("{}<code>{}</code><small>{}</small>").format(symbol, label, unit)
