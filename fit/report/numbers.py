"""The numbers of a figure in tables of a few lines, for readers whose browser runs no scripts."""

import datetime as dt
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from fit.figures import Axis, Chart, Curve, Note, Panel, Points, Span
from fit.tables import parameters

Array = NDArray[np.float64]
_Row = tuple[str, list[str]]

_ROWS = 10  # stretches of an axis that is not logarithmic
_PLACES = 7  # of panels beside each other, at most
_NONE = "–"


@dataclass(frozen=True)
class _Group:
    """What panels show of one quantity, each mark once, and what their y axis shows."""

    title: str
    y: Axis
    up: tuple[float, float]
    marks: list[Curve | Points | Span | Note]

    @property
    def points(self) -> list[Points]:
        return [mark for mark in self.marks if isinstance(mark, Points)]

    @property
    def curves(self) -> list[Curve]:
        """Those that the legend names."""
        return [mark for mark in self.marks if isinstance(mark, Curve) and mark.label]

    @property
    def columns(self) -> list[Points | Curve]:
        """What has a column of its own: beside points, a curve that is level has not."""
        return [*self.points, *(c for c in self.curves if not (self.points and _level(c)))]

    @cached_property
    def power(self) -> int:
        """The power of ten, of thousands, in which curves over decades have short numbers."""
        if not self.y.log or self.points:
            return 0
        values = np.concatenate([curve.y[curve.y > 0] for curve in self.curves])
        return 3 * math.floor(math.log10(np.median(values)) / 3) if values.size else 0


def tables(chart: Chart) -> Markup:
    """Return what a figure shows: measured points whole, curves thinned, and nothing twice.

    A logarithmic axis is told at three places of each decade, any other in ten stretches, of which least and
    largest are told. Panels beside each other have a line each.
    """
    main_panel = chart.panels[0]
    if any(line.name == main_panel.title for line in main_panel.lines):
        return _side_by_side(chart.panels)
    groups = _groups(chart.panels)
    blocks = []
    for pointed in (False, True):
        members = [group for group in groups if bool(group.points) == pointed and group.columns]
        if members:
            rows = _points(main_panel.x, members) if pointed else _thinned(main_panel, members)
            blocks.append(_written(main_panel.x, members, rows))
    return Markup("\n").join(blocks)


def _groups(panels: Sequence[Panel]) -> list[_Group]:
    groups: dict[tuple[str, Axis], _Group] = {}
    for panel in panels:
        group = groups.setdefault((panel.title, panel.y), _Group(panel.title, panel.y, panel.up, []))
        group.marks.extend(m for m in panel.marks if not (isinstance(m, Curve | Points) and m.is_repeated))
    return list(groups.values())


def _level(curve: Curve) -> bool:
    return bool(curve.y.size and np.ptp(curve.y) == 0)


def _thinned(panel: Panel, groups: Sequence[_Group]) -> list[_Row]:
    """Return lines of curves, at some places or of some stretches."""
    low, high = panel.across
    curves = [(group, curve) for group in groups for curve in group.curves]
    if panel.x.log:
        places = [m * 10.0**e for e in range(-12, 12) for m in (1, 2, 5)]
        shown = [x for x in places if low * 0.999 <= x <= high * 1.001]
        return [(_text(x), [_value_at(group, curve, x) for group, curve in curves]) for x in shown]
    edges = np.linspace(low, high, _ROWS + 1)
    return [
        (f"{_text(a)} … {_text(b)}", [_extremes(curve, a, b) for _, curve in curves])
        for a, b in pairwise(edges)
    ]


def _value_at(group: _Group, curve: Curve, x: float) -> str:
    """Return the value next to a place, with its band, if there is one within a tenth of a decade."""
    nearest = int(np.argmin(np.abs(np.log(curve.x / x)))) if curve.x.size else -1
    if nearest < 0 or not 0.8 < curve.x[nearest] / x < 1.25:
        return _NONE
    factor, lowest = 10.0**-group.power, group.up[0] if group.y.log else -math.inf
    if curve.y[nearest] < lowest:
        return f"< {_text(lowest * factor)}"
    text = _text(float(curve.y[nearest]) * factor)
    if curve.low is None or curve.high is None:
        return text
    low, high = (_text(float(bound[nearest]) * factor) for bound in (curve.low, curve.high))
    return Markup("{} <small>({} to {})</small>").format(text, low, high)


def _extremes(curve: Curve, low: float, high: float) -> str:
    inside = curve.y[(curve.x >= low) & (curve.x <= high) & np.isfinite(curve.y)]
    if not inside.size:
        return _NONE
    smallest, largest = _text(float(inside.min())), _text(float(inside.max()))
    return smallest if smallest == largest else f"{smallest} … {largest}"


def _points(x: Axis, groups: Sequence[_Group]) -> list[_Row]:
    """Return a line for every name and place, then those of what is level throughout."""
    columns = [(group, mark) for group in groups for mark in group.columns]
    order, cells = dict[str, float](), [dict[str, str]() for _ in columns]
    for (_, mark), column in zip(columns, cells, strict=True):
        if isinstance(mark, Points):
            for i, place in enumerate(mark.places.tolist()):
                head = _head(x, place, mark.names[i] if mark.names else "", mark.label)
                order.setdefault(head, float(f"{place:.12g}"))  # without what moved marks aside and back
                column[head] = _measured(mark, i)
    for (_, mark), column in zip(columns, cells, strict=True):
        if isinstance(mark, Curve):
            column |= {h: _text(float(np.interp(position, mark.x, mark.y))) for h, position in order.items()}
    heads = sorted(order, key=lambda head: order[head])
    return [(head, [column.get(head, "") for column in cells]) for head in heads]


def _head(axis: Axis, x: float, name: str, label: str) -> str:
    """Return name and place of a point, without a name that the column or the place has."""
    place = _place(axis, x)
    return f"{name}, {place}" if name and name != label and not place.startswith(name) else place


def _measured(mark: Points, i: int) -> str:
    """Return a point, with the half width of its error bar."""
    if not mark.caps:
        return _text(float(mark.y[i]))
    text = parameters.number(float(mark.y[i]), float(mark.high[i] - mark.low[i]) / 2)
    return f"{text.value} ± {text.sigma}"


def _levels(group: _Group) -> dict[str, str]:
    """Return what holds throughout, by label: a value with the sigma shaded about it, limits, or a range."""
    spans = [mark for mark in group.marks if isinstance(mark, Span) and mark.along == "y"]
    levels = {s.label: f"{_text(s.low)} … {_text(s.high)}" for s in spans if s.label}
    curves = [mark for mark in group.marks if isinstance(mark, Curve) and _level(mark)]
    # of two limits that are drawn alike, the legend names one
    for _, members in groupby(curves, key=lambda curve: (curve.role, curve.dash)):
        head_curve, *rest = members
        if head_curve.label:
            levels[head_curve.label] = " and ".join(
                _constant(spans, float(c.y[0])) for c in (head_curve, *rest)
            )
    return levels


def _constant(spans: Sequence[Span], y: float) -> str:
    for span in spans:
        if np.isclose((span.low + span.high) / 2, y, 1e-12, 0):
            text = parameters.number(y, (span.high - span.low) / 2)
            return f"{text.value} ± {text.sigma}"
    return _text(y)


def _side_by_side(panels: Sequence[Panel]) -> Markup:
    """Return a table with a line for every panel: values at some places, and half of the band about zero."""
    x = panels[0].lines[0].x
    step = -(-x.size // _PLACES)
    shown = range((x.size - 1) % step // 2, x.size, step)
    lines = []
    for panel in panels:
        curve = next(line for line in panel.lines if line.name == panel.title)
        band = next((c for c in panel.lines if c.name != panel.title and c.low is not None), curve)
        cells = [_within_band(float(curve.y[i]), band, i) for i in shown]
        lines.append(_line(panel.title, _cells("td", cells)))
    axes = f"{panels[0].y.title}, by {panels[0].x.title}"
    names = [line.name for line in panels[0].lines if line.name != panels[0].title]
    caption = f"{axes} (±: {', '.join(names)})" if names else axes
    places = _cells("th", list(map(_text, x[list(shown)].tolist())), scope="col")
    return _table(caption, [Markup("<td></td>{}").format(places)], lines)


def _within_band(y: float, band: Curve | Points, i: int) -> str:
    if band.low is None or band.high is None:
        return _text(y)
    text = parameters.number(y, float(band.high[i] - band.low[i]) / 2)
    return Markup("{} <small>(±{})</small>").format(text.value, text.sigma)


def _written(x: Axis, groups: Sequence[_Group], rows: Sequence[_Row]) -> Markup:
    """Return a table: of one quantity the caption says which, of more a line above their columns."""
    columns = [mark for group in groups for mark in group.columns]
    heads = [_cells("th", [mark.label.replace("_", " ") or mark.name for mark in columns], scope="col")]
    widths = [len(group.columns) for group in groups]
    if len(groups) > 1:
        heads.insert(0, _cells("th", list(map(_titled, groups)), widths, scope="colgroup"))
    head = [
        Markup('<th scope="col" rowspan="{}">{}</th>{}').format(len(heads), x.title, heads[0]),
        *heads[1:],
    ]
    levels = [_levels(group) if group.points else {} for group in groups]
    body = [_line(head_cell, _cells("td", cells)) for head_cell, cells in rows]
    for name in dict.fromkeys(name for level_names in levels for name in level_names):
        body.append(_line(name, _cells("td", [level_names.get(name, "") for level_names in levels], widths)))
    return _table(_titled(groups[0]) if len(groups) == 1 else "", head, body)


def _titled(group: _Group) -> str:
    """Return what a group measures, in the power of ten of its numbers."""
    power = group.power
    unit = f"{parameters.unit_text('1', power)} {group.y.unit}".strip() if power else group.y.unit
    title = f"{group.y.label}  [{unit}]" if unit else group.y.label
    return f"{group.title}: {title}" if group.title else title


def _line(head_cell: str, cells: Markup) -> Markup:
    return Markup('<th scope="row">{}</th>{}').format(head_cell, cells)


def _cells(tag: str, texts: Sequence[str], widths: Sequence[int] = (), **attributes: str) -> Markup:
    """Return cells, so many columns wide."""
    cells = []
    for text, width in zip(texts, widths or [1] * len(texts), strict=True):
        cell_attributes = attributes | ({"colspan": str(width)} if width > 1 else {})
        inside = "".join(f' {name}="{escape(value)}"' for name, value in cell_attributes.items())
        cells.append(f"<{tag}{inside}>{escape(text)}</{tag}>")
    return Markup("".join(cells))


def _table(caption: str, head: Sequence[Markup], body: Sequence[Markup]) -> Markup:
    heading = Markup("<caption>{}</caption>").format(caption) if caption else ""
    head, body = ([Markup("<tr>{}</tr>").format(line) for line in part] for part in (head, body))
    return Markup(
        '<div class="scroll" tabindex="0"><table class="numbers">{}<thead>{}</thead><tbody>\n{}\n</tbody>'
        "</table></div>"
    ).format(heading, Markup().join(head), Markup("\n").join(body))


def _place(axis: Axis, x: float) -> str:
    if axis.dates:
        return f"{dt.datetime.fromtimestamp(x, dt.UTC):%Y-%m-%d}"
    return _text(x)


def _text(value: float) -> str:
    """Return a number in print with three digits, ``1.2·10⁻¹⁴``."""
    value = float(f"{value:.3g}") + 0.0  # no negative zero
    if not math.isfinite(value):
        return _NONE
    text = f"{value:.0f}" if 1e3 <= abs(value) < 1e5 else f"{value:.3g}"
    mantissa, _, exponent = text.partition("e")
    text = f"{mantissa}·{parameters.unit_text('1', int(exponent))}" if exponent else mantissa
    return text.replace("-", "−")
