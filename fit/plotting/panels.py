"""Charts as matplotlib draws them."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from fit.figures import COLOURS, Chart, Curve, Note, Panel, Points, Span
from fit.plotting.style import WIDE, WIDTH

_LEFT_MARGIN, _RIGHT, _BOTTOM, _LINE = 0.5, 0.12, 0.34, 0.14  # inch: margins of a figure, a line of a legend
_DAY = 86400.0  # s
_LETTER, _ENTRY = 0.05, 0.3  # inch: the width of a letter, and of a line of a legend besides, about
_MARKS: dict[str, Any] = {
    "dot": {"marker": "o", "markersize": 2.9, "capsize": 1.8},
    "ring": {"marker": "o", "markersize": 2.9, "capsize": 1.8, "markerfacecolor": COLOURS["paper"]},
    "square": {"marker": "s", "markersize": 5.5, "capsize": 3.5, "markerfacecolor": "none"},
}


def drawn(chart: Chart) -> Figure:
    """Return a chart, drawn: one column wide with the same margins in all figures, or a grid of panels.

    To have the margins measured is what takes longest in drawing.
    """
    return _grid(chart) if chart.n_across > 1 else _column(chart)


def _column(chart: Chart) -> Figure:
    panels = chart.panels
    left_margin = _LEFT_MARGIN + _LETTER * max(_digits(panel) for panel in panels)
    right = _RIGHT + (0.38 if any(map(_at_the_end, panels)) else 0.0)
    total = sum(panel.height for panel in panels) + _BOTTOM
    figure = Figure(figsize=(WIDTH, total))
    first_axes, height_below = None, total
    for panel in panels:
        height_below -= panel.height
        entries = [mark.label for mark in panel.marks if not isinstance(mark, Note) and mark.label]
        across = sum(_LETTER * len(label) + _ENTRY for label in entries) + _LETTER * len(panel.title)
        rows = max(1, math.ceil(across / (WIDTH - right)))
        columns = max(1, math.ceil(len(entries) / rows))
        width, height = WIDTH - left_margin - right, panel.height - rows * _LINE - 0.1
        place = (left_margin / WIDTH, height_below / total, width / WIDTH, height / total)
        ax = figure.add_axes(place, sharex=first_axes)
        first_axes = first_axes or ax
        _draw(ax, panel)
        long = _LETTER * len(panel.y.title) > height
        ax.yaxis.set_label_coords(((0.24 if long else 0.14) - left_margin) / width, 0.5)
        ax.set_ylabel(panel.y.title.replace("  ", "\n") if long else panel.y.title)
        ax.set_title(panel.title, parse_math=False)
        if panel is panels[-1]:
            ax.set_xlabel(panel.x.title)
        else:
            ax.tick_params(labelbottom=False)
        if entries:
            ax.legend(
                loc="lower right",
                bbox_to_anchor=(1, 1.0),
                ncols=columns,
                borderaxespad=0.1,
                columnspacing=1.4,
            )
    return figure


def _digits(panel: Panel) -> int:
    """Return how many letters the numbers at the y axis take beyond three."""
    if panel.y.log:
        return 0
    low, high = panel.up
    ticks = [tick for tick in _locator(panel).tick_values(low, high) if low <= tick <= high]
    decimals = max(0, -math.floor(math.log10(min(np.diff(ticks), default=1.0)) + 1e-9))
    return max(0, max((len(f"{tick:.{decimals}f}") for tick in ticks), default=0) - 3)


def _locator(panel: Panel) -> MaxNLocator:
    """Return what chooses the numbers at a linear y axis: steps of 1, 2 or 5, as many as have room."""
    return MaxNLocator(max(3, round(3.5 * panel.height)), steps=[1, 2, 5, 10])


def _at_the_end(panel: Panel) -> bool:
    """Tell whether words stand beyond the right end of a panel."""
    return any(isinstance(mark, Note) and mark.x >= panel.across[1] for mark in panel.marks)


def _grid(chart: Chart) -> Figure:
    panels, columns = chart.panels, chart.n_across
    rows = math.ceil(len(panels) / columns)
    width = WIDE if columns > 2 else WIDTH
    figure = Figure(figsize=(width, panels[0].height * rows + 0.3), layout="constrained")
    places = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for ax, panel in zip(places.flat, panels, strict=False):
        _draw(ax, panel)
        ax.set_title(panel.title, fontsize=7, parse_math=False)
        last_tick = math.floor(panel.across[1])
        ax.set_xticks([-last_tick, 0, last_tick], [f"−{last_tick}", "0", f"{last_tick}"])
    for ax in places.flat[len(panels) :]:
        ax.set_visible(False)
    figure.supxlabel(panels[0].x.title, fontsize=7)
    figure.supylabel(panels[0].y.title.replace(" − ", " −\n"), fontsize=7, multialignment="center")
    return figure


def _draw(ax: Axes, panel: Panel) -> None:
    """Draw what stands in a panel, and set up its axes."""
    if panel.x.log and panel.y.log:
        _loglog(ax)
    if panel.x.dates:
        panel = _in_days(panel)
        _dates(ax)
    for order, mark in enumerate(panel.marks):
        if isinstance(mark, Curve):
            _curve(ax, mark, 2 + 0.01 * order)
        elif isinstance(mark, Points):
            _points(ax, mark)
        elif isinstance(mark, Span):
            shade = ax.axvspan if mark.along == "x" else ax.axhspan
            style: dict[str, Any] = {
                "color": COLOURS[mark.role],
                "alpha": mark.opacity,
                "linewidth": mark.edge,
            }
            shade(mark.low, mark.high, label=mark.label or "_", zorder=0.5, **style)
        else:
            _note(ax, mark)
    ax.set_xlim(*panel.across)
    ax.set_ylim(*panel.up)
    if not panel.y.log:
        ax.yaxis.set_major_locator(_locator(panel))
        ax.ticklabel_format(axis="y", useOffset=False)


def _curve(ax: Axes, curve: Curve, order: float) -> None:
    colour = COLOURS[curve.role]
    if curve.low is not None and curve.high is not None:
        ax.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0)
    style: dict[str, Any] = {"linewidth": curve.width, "linestyle": curve.dash, "alpha": curve.opacity}
    if curve.dots:
        style |= {"marker": "o", "markersize": 1.8}
    ax.plot(curve.x, curve.y, color=colour, label=_text(curve.label) or "_", zorder=order, **style)


def _points(ax: Axes, points: Points) -> None:
    bars = np.maximum(np.stack([points.y - points.low, points.high - points.y]), 0)
    style = {**_MARKS[points.mark], "color": COLOURS[points.role], "elinewidth": 0.7, "linestyle": "none"}
    if not points.caps:
        style["capsize"] = 0
    x = points.x
    ax.errorbar(x, points.y, bars, label=_text(points.label) or "_", zorder=3, **style)


def _note(ax: Axes, note: Note) -> None:
    style: dict[str, Any] = {"color": COLOURS["muted"], "fontsize": 6, "textcoords": "offset points"}
    if note.y is None:
        ax.annotate(note.text, (note.x, 0), (3, 3), xycoords=ax.get_xaxis_transform(), **style)
    else:
        ax.annotate(note.text, (note.x, note.y), (4, 0), va="center", annotation_clip=False, **style)


def _text(label: str) -> str:
    """Return a label with its subscripts as matplotlib sets them."""
    subscript = re.sub(r"_(\S+)", r"$_{\1}$", label)
    return subscript.replace("dΩ", r"\dot\Omega")


def _in_days(panel: Panel) -> Panel:
    """Return a panel whose x axis counts days since 1970, as matplotlib does."""
    marks = [replace(m, x=m.x / _DAY) if isinstance(m, Curve | Points) else m for m in panel.marks]
    return replace(panel, marks=tuple(marks), across=(panel.across[0] / _DAY, panel.across[1] / _DAY))


def _dates(ax: Axes) -> None:
    """Let an axis of days since 1970 tell dates."""
    ticks = AutoDateLocator(maxticks=6)  # type: ignore[no-untyped-call]
    ax.xaxis.set_major_locator(ticks)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(ticks))  # type: ignore[no-untyped-call]


def _loglog(ax: Axes) -> None:
    for axis, scale in ((ax.xaxis, ax.set_xscale), (ax.yaxis, ax.set_yscale)):
        scale("log")
        axis.set_major_locator(LogLocator(numticks=9))
        axis.set_major_formatter(FuncFormatter(_power))
        axis.set_minor_formatter(NullFormatter())
    ax.yaxis.set_minor_locator(NullLocator())
    ax.grid(visible=True, which="minor", linewidth=0.25)


def _power(value: float, _: object) -> str:
    """Return a power of ten in print."""
    digits = str(round(math.log10(value))).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{digits}"
