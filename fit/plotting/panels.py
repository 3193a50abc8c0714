"""Charts as matplotlib draws them."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from fit.figures import COLOURS, Chart, Curve, Note, Panel, Points, Span
from fit.plotting.style import WIDTH

_MARGIN, _BOTTOM = 0.12, 0.34  # inch: at the sides of a figure, and below its panels
_DAY = 86400.0  # s
_LETTER, _ENTRY = 0.05, 0.3  # inch: the width of a letter, and of a line of a legend besides, about
_MARKS: dict[str, Any] = {
    "dot": {"marker": "o", "markersize": 2.9, "capsize": 1.8},
    "square": {"marker": "s", "markersize": 5.5, "capsize": 3.5, "markerfacecolor": "none"},
}


def draw(chart: Chart) -> Figure:
    """Draw panels above each other, one column wide, each with its legend in the line of its title."""
    panels = chart.panels
    heights = [panel.height for panel in panels]
    figure = Figure(figsize=(WIDTH, sum(heights) + _BOTTOM), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for ax, panel in zip(axes, panels, strict=True):
        _draw(ax, panel)
        is_long = _LETTER * len(panel.y.title) > panel.height - 2 * _MARGIN
        ax.set_ylabel(panel.y.title.replace("  ", "\n") if is_long else panel.y.title)
        ax.set_title(panel.title, parse_math=False)
        labels = [mark.label for mark in panel.marks if not isinstance(mark, Note) and mark.label]
        width = sum(_LETTER * len(label) + _ENTRY for label in labels) + _LETTER * len(panel.title)
        if labels:
            columns = math.ceil(len(labels) / math.ceil(width / (WIDTH - _MARGIN)))
            ax.legend(
                loc="lower right",
                bbox_to_anchor=(1, 1.0),
                ncols=columns,
                borderaxespad=0.1,
                columnspacing=1.4,
            )
    figure.align_ylabels(axes)
    axes[-1].set_xlabel(panels[-1].x.title)
    return figure


def draw_on(axes: Sequence[Axes], chart: Chart) -> None:
    """Draw the panels of a chart on axes, with titles, labels and legends."""
    for ax, panel in zip(axes, chart.panels, strict=True):
        _draw(ax, panel)
        ax.set_ylabel(panel.y.title)
        ax.set_title(panel.title, parse_math=False)
        if any(mark.label for mark in panel.marks if not isinstance(mark, Note)):
            ax.legend()
    axes[-1].set_xlabel(chart.panels[-1].x.title)


def _draw(ax: Axes, panel: Panel) -> None:
    """Draw the marks of a panel, and set up its axes."""
    _log_scales(ax, panel)
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
        # steps of 1, 2 or 5, as many as have room
        ax.yaxis.set_major_locator(MaxNLocator(max(3, round(3.5 * panel.height)), steps=[1, 2, 5, 10]))
        ax.ticklabel_format(axis="y", useOffset=False)


def _curve(ax: Axes, curve: Curve, order: float) -> None:
    colour = COLOURS[curve.role]
    if curve.low is not None and curve.high is not None:
        ax.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0)
    style: dict[str, Any] = {"linewidth": curve.width, "linestyle": curve.dash, "alpha": curve.opacity}
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
    """Label an axis of days since 1970 with dates."""
    ticks = AutoDateLocator(maxticks=6)  # type: ignore[no-untyped-call]
    ax.xaxis.set_major_locator(ticks)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(ticks))  # type: ignore[no-untyped-call]


def _log_scales(ax: Axes, panel: Panel) -> None:
    """Set up the logarithmic axes of a panel, with powers of ten."""
    for axis, name, is_log in ((ax.xaxis, "x", panel.x.log), (ax.yaxis, "y", panel.y.log)):
        if is_log:
            ax.set(**{f"{name}scale": "log"})
            axis.set_major_locator(LogLocator(numticks=9))
            axis.set_major_formatter(FuncFormatter(_power))
            axis.set_minor_formatter(NullFormatter())
    if panel.y.log:
        ax.yaxis.set_minor_locator(NullLocator())
    if panel.x.log:
        ax.grid(visible=True, which="minor", linewidth=0.25)


def _power(value: float, _: object) -> str:
    """Return a power of ten in print."""
    digits = str(round(math.log10(value))).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{digits}"
