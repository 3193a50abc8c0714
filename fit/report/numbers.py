"""The numbers of a figure in a table of a few lines, for readers whose browser runs no scripts."""

import datetime as dt
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from fit.figures import Axis, Curve, Panel, Points, Span
from fit.tables import parameters

Array = NDArray[np.float64]

_ALL = 40  # values of a curve at most, to list every one
_ROWS = 10  # otherwise
_DIGITS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def table(panel: Panel) -> Markup:
    """Return a table of what stands in a panel: measured points and short curves whole, long curves thinned.

    A logarithmic axis is told at three places of each decade, any other in ten stretches, of which least and
    largest are told.
    """
    lines = [
        mark for mark in panel.lines if mark.label or isinstance(mark, Points) or mark.name == panel.title
    ]
    parts = []
    for own in _together(lines):
        rows = _rows(panel, own)
        if rows:
            parts.append(_written(panel, own, rows))
    return Markup("\n").join(parts)


def _together(lines: Sequence[Curve | Points]) -> list[list[Curve | Points]]:
    """Return which lines share a table: the long ones, and each of the others alone."""
    long = [line for line in lines if line.x.size > _ALL]
    return ([long] if long else []) + [[line] for line in lines if line.x.size <= _ALL]


def _rows(panel: Panel, lines: Sequence[Curve | Points]) -> list[list[str]]:
    if lines[0].x.size <= _ALL:
        return _each(panel, lines[0])
    low, high = panel.across
    if panel.x.log:
        places = [m * 10.0**e for e in range(-12, 12) for m in (1, 2, 5)]
        return [
            [_text(x), *(_at(line, x) for line in lines)] for x in places if low * 0.999 <= x <= high * 1.001
        ]
    edges = np.linspace(low, high, _ROWS + 1)
    return [
        [f"{_text(a)} … {_text(b)}", *(_extremes(line, a, b) for line in lines)] for a, b in pairwise(edges)
    ]


def _each(panel: Panel, line: Curve | Points) -> list[list[str]]:
    """Return a row for every point, with the half width of its error bar or band."""
    if isinstance(line, Curve) and line.y.size and np.ptp(line.y) == 0:
        return [["throughout", _constant(panel, float(line.y[0]))]]
    rows, places = [], line.places if isinstance(line, Points) else line.x
    for i, (x, y) in enumerate(zip(places, line.y, strict=True)):
        told = _text(float(y))
        if isinstance(line, Points) and line.caps:
            found = parameters.number(float(y), float(line.high[i] - line.low[i]) / 2)
            told = f"{found.value} ± {found.sigma}"
        name = line.names[i] if isinstance(line, Points) and line.names else ""
        rows.append([f"{name} {_place(panel.x, float(x))}".strip(), told])
    return rows


def _constant(panel: Panel, y: float) -> str:
    """Return a value that holds throughout, with its sigma where a band about it is shaded."""
    for mark in panel.marks:
        if (
            isinstance(mark, Span)
            and mark.along == "y"
            and np.isclose((mark.low + mark.high) / 2, y, 1e-12, 0)
        ):
            found = parameters.number(y, (mark.high - mark.low) / 2)
            return f"{found.value} ± {found.sigma}"
    return _text(y)


def _place(axis: Axis, x: float) -> str:
    if axis.dates:
        return dt.datetime.fromtimestamp(x, dt.UTC).strftime("%Y-%m-%d %H:%M")
    return _text(x)


def _at(line: Curve | Points, x: float) -> str:
    """Return the value next to a place, if there is one within a tenth of a decade."""
    near = int(np.argmin(np.abs(np.log(line.x / x))))
    return _text(float(line.y[near])) if 0.8 < line.x[near] / x < 1.25 else "–"


def _extremes(line: Curve | Points, low: float, high: float) -> str:
    inside = line.y[(line.x >= low) & (line.x <= high) & np.isfinite(line.y)]
    return f"{_text(float(inside.min()))} … {_text(float(inside.max()))}" if inside.size else "–"


def _text(value: float) -> str:
    """Return a number in print, ``1.2·10⁻¹⁴``."""
    if not np.isfinite(value):
        return "–"
    value += 0.0  # no negative zero
    text = f"{value:.3g}" if abs(value) < 1e5 else f"{value:.2e}"
    mantissa, _, exponent = text.partition("e")
    told = f"{mantissa}·10{str(int(exponent)).translate(_DIGITS)}" if exponent else mantissa
    return told.replace("-", "−")


def _written(panel: Panel, lines: Sequence[Curve | Points], rows: Sequence[Sequence[str]]) -> Markup:
    heads = [panel.x.title, *(line.label.replace("_", " ") or line.name for line in lines)]
    head = Markup().join(Markup('<th scope="col">{}</th>').format(text) for text in heads)
    cells = Markup("<td>{}</td>")
    body = [
        Markup('<tr><th scope="row">{}</th>{}</tr>').format(first, Markup().join(map(cells.format, others)))
        for first, *others in rows
    ]
    title = f"{panel.title}: {panel.y.title}" if panel.title else panel.y.title
    return Markup(
        '<div class="scroll" tabindex="0"><table class="numbers"><caption>{}</caption><thead><tr>{}</tr>'
        "</thead><tbody>\n{}\n</tbody></table></div>"
    ).format(title, head, Markup("\n").join(body))
