"""A table as text, as an element of a notebook, and as the page shows it."""

from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import Markup

from fit.tables.numbers import signed

LIMIT = 4.0  # sigma, beyond which page and tables flag a difference

Cell = str | None


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes
    ----------
    head : tuple of str, length C
        Over the columns.
    rows : sequence of tuple, each of length C
        In every cell a text, or None.
    caption : str
        What it shows.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""

    def filled(self, n_always: int = 0) -> "Table":
        """Return the table without columns that are empty, but for the first `n_always`."""
        columns = [i for i in range(len(self.head)) if i < n_always or any(row[i] for row in self.rows)]
        rows = tuple(tuple(row[i] for i in columns) for row in self.rows)
        return Table(tuple(self.head[i] for i in columns), rows, self.caption)

    def aligned(self) -> list[str]:
        """Return the lines of the table in letters of one width."""
        lines = [list(self.head), *([cell or "" for cell in row] for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return ["  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]

    def html(self) -> Markup:
        """Return an element of a notebook."""

        def line(tag: str, cells: Iterable[Cell]) -> Markup:
            cell = Markup(f'<{tag} style="text-align:left">{{}}</{tag}>')
            return Markup("<tr>{}</tr>").format(Markup().join(cell.format(text or "") for text in cells))

        body = Markup().join(line("td", row) for row in self.rows)
        return Markup("<table>{}{}</table>").format(line("th", self.head), body)


def html_list(lines: Iterable[str]) -> Markup:
    """Return lines as an element of a notebook."""
    return Markup("<ul>{}</ul>").format(Markup().join(map(Markup("<li>{}</li>").format, lines)))


def highlight(text: str, condition: bool) -> str:
    """Return a text, in the colour of errors if a condition holds."""
    return Markup('<span class="off">{}</span>').format(text) if condition else text


def pull_text(pull: float, decimals: int = 1) -> str:
    """Return a difference in units of its sigma, highlighted beyond the `LIMIT`."""
    return highlight(signed(pull, decimals), abs(pull) > LIMIT)


def name_head(symbol: Markup, name: str, unit: str = "") -> Markup:
    """Return the head of a row: symbol, name as in the files, and unit in print."""
    label = f"{name} [{unit}]" if unit else name
    return Markup("{}<code>{}</code><small>{}</small>").format(symbol, label, unit)
