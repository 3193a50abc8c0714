"""A figure of the report as files, SVG, PDF and CSV, and as an element of the page."""

import csv
import io
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from fit.figures.style import COLOURS, WIDTH, style
from fit.files import atomic

Array = NDArray[np.float64]
Columns = dict[str, Sequence[object] | NDArray[np.generic]]


@dataclass(frozen=True)
class Axis:
    """What an axis measures.

    Attributes
    ----------
    label, unit : str
        On the figure, the unit in print: ``"ASD"`` and ``"m s⁻²/√Hz"``.
    head : str
        Of its column in the table, name and unit as telemetry spells it: ``"asd [m s-2 Hz-1/2]"``.
    log : bool
        Whether it is logarithmic.
    """

    label: str
    unit: str
    head: str
    log: bool = False

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label}  [{self.unit}]"


FREQUENCY = Axis("frequency", "Hz", "f [Hz]", log=True)
ASD = Axis("ASD", "m s⁻²/√Hz", "asd [m s-2 Hz-1/2]", log=True)
TIME = Axis("time since start of run", "h", "t [h]")


@dataclass(frozen=True)
class Curve:
    """A curve as it is drawn and written.

    Attributes
    ----------
    name : str
        Plain words.
    x, y : ndarray, shape (N,)
        NaN where there is a gap.
    low, high : ndarray, shape (N,), optional
        A band about it.
    """

    name: str
    x: Array
    y: Array
    low: Array | None = None
    high: Array | None = None


@dataclass(frozen=True)
class Panel:
    """Axes of a figure that the page can zoom and read off.

    Attributes
    ----------
    ax : Axes
        Those of matplotlib.
    x, y : Axis
        What they measure.
    curves : list of tuple of (Curve, Line2D)
        As they were drawn.
    moving, vanishing : list of Artist
        What moves along with the curves when the axes are zoomed, and what is to vanish then.
    """

    ax: Axes
    x: Axis
    y: Axis
    curves: list[tuple[Curve, Line2D]] = field(default_factory=list)
    moving: list[Artist] = field(default_factory=list)
    vanishing: list[Artist] = field(default_factory=list)

    def draw(self, curve: Curve, role: str, **style: Any) -> None:
        """Draw a curve and its band in the colour of a role."""
        colour = COLOURS[role]
        if curve.low is not None and curve.high is not None:
            band = self.ax.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0)
            self.moving.append(band)
        (line,) = self.ax.plot(curve.x, curve.y, color=colour, **style)
        self.curves.append((curve, line))


@dataclass(frozen=True)
class Plot:
    """A figure and the numbers it draws.

    Attributes
    ----------
    figure : Figure
        As matplotlib has it.
    columns : mapping of str to sequence
        Of equal length, by name and unit: ``"f [Hz]"``.
    panels : sequence of Panel
        The axes that can be zoomed and read off in the page.
    titles : mapping of str to str
        What to tell where the pointer rests on an element, by its ``gid``.
    """

    figure: Figure
    columns: Mapping[str, Sequence[object] | NDArray[np.generic]]
    panels: Sequence[Panel] = ()
    titles: Mapping[str, str] = field(default_factory=dict)


def plot(figure: Figure, panels: Sequence[Panel]) -> Plot:
    """Return a figure with the curves of its panels as columns, one curve below the other."""
    curves = [curve for panel in panels for curve, _ in panel.curves]
    columns: Columns = {
        "curve": [curve.name for curve in curves for _ in curve.x],
        panels[-1].x.head: np.concatenate([curve.x for curve in curves]),
        panels[-1].y.head: np.concatenate([curve.y for curve in curves]),
    }
    if any(curve.low is not None for curve in curves):
        for key in ("low", "high"):
            bounds = [getattr(curve, key) for curve in curves]
            whole = [
                np.full(c.x.size, np.nan) if b is None else b for c, b in zip(curves, bounds, strict=True)
            ]
            columns[key] = np.concatenate(whole)
    return Plot(figure, columns, panels)


def drawn(draw: Callable[..., Plot], *arguments: object) -> Plot:
    """Return a figure in the style of the report; `draw` is called with `arguments`."""
    with mpl.rc_context(style()):
        return draw(*arguments)


def svg(plot: Plot) -> str:
    """Return a figure as an SVG document, the same for the same figure."""
    elements = _elements(plot)
    with mpl.rc_context(style()):
        text = io.StringIO()
        plot.figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    # A hundredth of a point is finer than any screen; a third of the file is digits beyond it.
    document = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text.getvalue())
    return re.sub(r'<g id="([\w-]+)">', lambda group: elements.get(group[1], group[0]), document)


def _elements(plot: Plot) -> dict[str, str]:
    """Return the tags that tell the page of axes, curves and titles, by the id that matplotlib gives them.

    What is not known to matplotlib is named here.
    """
    found = {key: f'<g id="{key}"><title>{escape(text)}</title>' for key, text in plot.titles.items()}
    marks: list[tuple[Artist, str]] = []
    for panel in plot.panels:
        key = f"axes_{plot.figure.axes.index(panel.ax) + 1}"
        told = escape(json.dumps(_frame(panel), ensure_ascii=False))
        found[key] = f'<g id="{key}" data-axes="{told}">'
        marks += [(line, f'data-curve="{escape(curve.name)}"') for curve, line in panel.curves]
        marks += [(artist, 'data-moves=""') for artist in panel.moving]
        marks += [(artist, 'data-vanishes=""') for artist in panel.vanishing]
    for i, (artist, attribute) in enumerate(marks):
        artist.set_gid(f"mark-{i}")
        found[f"mark-{i}"] = f"<g {attribute}>"
    return found


def _frame(panel: Panel) -> dict[str, object]:
    """Return where the axes are in the SVG [pt], top left corner and size, and what they measure."""
    figure = panel.ax.get_figure(root=True)
    assert figure is not None
    width, height = 72 * figure.get_size_inches()
    place = panel.ax.get_position()
    box = (place.x0 * width, (1 - place.y1) * height, place.width * width, place.height * height)
    frame: dict[str, object] = {"box": [round(float(side), 3) for side in box]}
    for key, of, axis, side in (
        ("x", panel.x, panel.ax.xaxis, "labelbottom"),
        ("y", panel.y, panel.ax.yaxis, "labelleft"),
    ):
        frame[key] = {
            # fewer digits than sums of products in whatever order agree in
            "limits": [float(f"{limit:.9g}") for limit in axis.get_view_interval()],
            "log": of.log,
            "label": of.label,
            "unit": of.unit,
            "ticks": bool(axis.get_tick_params()[side]),
        }
    return frame


def save(plot: Plot, path: Path) -> None:
    """Write a figure alone, in the format that the suffix of `path` tells."""
    with mpl.rc_context(style()):
        plot.figure.savefig(path)


def write(folder: Path, name: str, draw: Callable[..., Plot], *arguments: object) -> str:
    """Write NAME.svg, NAME.pdf and NAME.csv, the same bytes for the same arguments; return the SVG.

    Parameters
    ----------
    folder : Path
        An existing one.
    draw : callable
        Called with `arguments` in the style of the report.
    """
    plot = drawn(draw, *arguments)
    document = svg(plot)
    with mpl.rc_context(style()):
        plot.figure.set_layout_engine("none")  # what it has found stays: the second file is cheaper
        nothing = {"CreationDate": None, "Creator": None, "Producer": None}
        pdf = io.BytesIO()
        plot.figure.savefig(pdf, format="pdf", metadata=nothing)
    table = io.StringIO()
    lines = csv.writer(table, lineterminator="\n")
    lines.writerow(plot.columns)
    lines.writerows(zip(*(map(_cell, column) for column in plot.columns.values()), strict=True))
    for suffix, content in (("pdf", pdf.getvalue()), ("svg", document), ("csv", table.getvalue())):
        atomic.write(folder / f"{name}.{suffix}", content)
    return document


def _cell(value: object) -> str:
    """Return a cell of a table; one without a number is empty."""
    if isinstance(value, float | np.floating):
        return f"{value:.8g}" if np.isfinite(value) else ""
    return str(value)


@dataclass(frozen=True)
class Drawing:
    """A figure of the page: an SVG element, what to see in it, and the name of its files in ``figures/``."""

    svg: Markup
    caption: str
    name: str


def drawing(
    folder: Path,
    name: tuple[str, ...],
    description: str,
    caption: str,
    draw: Callable[..., Plot],
    *arguments: object,
) -> Drawing:
    """Draw a figure, write its files to ``folder`` and return it for the page; see `write`.

    Parameters
    ----------
    name : tuple of str
        What the ids of the figure begin with, unique in the page, letters and digits; and what its files are
        told by besides.
    description, caption : str
        Alternative text, plain words without markup; and what stands below the figure.
    """
    file = "-".join(name)
    document = write(folder, file, draw, *arguments)
    return Drawing(Markup(_inline(document, name[0], description)), caption, file)


def _inline(document: str, name: str, description: str) -> str:
    """Return an SVG document as an element for a page: scalable, described, its colours CSS variables."""
    root, body = document[document.index("<svg") :].split(">", maxsplit=1)
    view_box = re.findall(r'viewBox="[^"]*"', root)[0]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{name}-", body)
    for role, colour in COLOURS.items():
        body = body.replace(colour, f"var(--{role})")
    return f'<svg {view_box} role="img" aria-label="{description}">{body}'


def column(height: float, x: Axis, *ys: Axis, legend: int = 1) -> tuple[Figure, list[Panel]]:
    """Return a figure of one column with panels above each other, all with the same margins in all figures.

    To have the margins measured is what takes longest in drawing.

    Parameters
    ----------
    height : float
        Of every panel, with the lines of its legend but without what is below the last [inch].
    x, *ys : Axis
        What the panels share, and what each of them shows.
    legend : int
        Number of lines above each.
    """
    left, right, bottom, line = 0.5, 0.12, 0.34, 0.14
    rows = len(ys)
    total = rows * height + bottom
    figure = Figure(figsize=(WIDTH, total))
    size = ((WIDTH - left - right) / WIDTH, (height - legend * line - 0.1) / total)
    places = [(left / WIDTH, (bottom + (rows - 1 - i) * height) / total, *size) for i in range(rows)]
    axes = [figure.add_axes(place) for place in places]
    for ax in axes[:-1]:
        ax.sharex(axes[-1])
        ax.tick_params(labelbottom=False)
    for ax, y in zip(axes, ys, strict=True):
        ax.yaxis.set_label_coords(-0.36 / (size[0] * WIDTH), 0.5)
        ax.set_ylabel(y.title)
        if x.log and y.log:
            _loglog(ax)
    axes[-1].set_xlabel(x.title)
    return figure, [Panel(ax, x, y) for ax, y in zip(axes, ys, strict=True)]


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


def legend_above(ax: Axes, columns: int) -> None:
    """Put the legend of an axis above its right end, clear of the curves."""
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1.0), ncols=columns, borderaxespad=0.1, columnspacing=1.4)
