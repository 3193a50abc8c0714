"""Tables of texts: made once, shown by the command line, as aligned columns, or in a notebook."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from fit.results import FIXED, WITHHELD, Fit


@dataclass(frozen=True)
class Lines:
    """A table: the heads of its columns, and rows of as many cells."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def truncate(self, columns: int) -> "Lines":
        """Return the table with its first columns alone."""
        return Lines(self.head[:columns], tuple(row[:columns] for row in self.rows))

    def aligned(self) -> list[str]:
        """Return the lines of the table in letters of one width."""
        widths = [max(map(len, column)) for column in zip(self.head, *self.rows, strict=True)]
        return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in (self.head, *self.rows)]

    def html(self, sides: str) -> Markup:
        """Return an element of a page; `sides` has an l or an r for each column."""
        styles = ["text-align:left" if side == "l" else "text-align:right" for side in sides]

        def line(tag: str, cells: tuple[str, ...]) -> Markup:
            filled = (
                Markup('<{} style="{}">{}</{}>').format(Markup(tag), style, cell, Markup(tag))
                for style, cell in zip(styles, cells, strict=True)
            )
            return Markup("<tr>{}</tr>").format(Markup().join(filled))

        body = Markup().join(line("td", row) for row in self.rows)
        head = line("th", self.head)
        return Markup("<table><thead>{}</thead><tbody>{}</tbody></table>").format(head, body)


def estimates(fits: Mapping[str, Fit], *, fine: bool = False) -> Lines:
    """Return the estimates of fits in SI units; sigmas and pulls that do not hold are withheld.

    Parameters
    ----------
    fits : mapping of str to Fit
        By what is added to the names of their parameters.
    fine : bool
        Give every number down to the second digit of its sigma, rather than six digits.
    """
    rows = []
    for suffix, fit in fits.items():
        for name, e in fit.parameters.items():
            numbers = [
                "" if x is None else digits(x, e.sigma) if fine else f"{x:.6g}" for x in (e.value, e.truth)
            ]
            sigma = WITHHELD if fit.unsound else f"{e.sigma:#.2g}" if fine else f"{e.sigma:.2g}"
            sigma = FIXED if e.fixed else sigma
            pull = "" if e.pull is None or fit.unsound else f"{e.pull:+.2f}"
            rows.append((name + suffix, e.unit, numbers[0], sigma, numbers[1], pull))
    return Lines(("parameter", "unit", "estimate", "sigma", "truth", "pull"), tuple(rows))


def digits(value: float, sigma: float) -> str:
    """Return a number down to the second digit of its sigma."""
    if not (value and sigma > 0):
        return f"{value:.6g}"
    places = math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 2
    return f"{value:.{min(max(places, 1), 15)}g}"
