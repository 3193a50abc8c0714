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
from markupsafe import escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from fit.figures import fonts as figure_fonts
from fit.files import atomic

Array = NDArray[np.float64]

#: Colours by role, on white; the report turns them into the variables of its light and dark scheme.
COLOURS: Mapping[str, str] = {
    "paper": "#ffffff",
    "ink": "#1c2530",
    "muted": "#5d6875",
    "grid": "#dfe3e8",
    "grey": "#8b95a1",
    "blue": "#2f74c0",
    "orange": "#d2541b",
    "green": "#1d8a6b",
    "violet": "#8457b8",
}
WIDTH, WIDE = 3.375, 7.0  # inch: one column and both of a journal's page
_STYLE: Any = {  # rc parameters; letters are readable in print and on a telephone of the same width
    "axes.edgecolor": COLOURS["muted"],
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": COLOURS["ink"],
    "axes.linewidth": 0.6,
    "axes.titlecolor": COLOURS["ink"],
    "axes.titlelocation": "left",
    "axes.titlesize": 7.2,
    "axes.unicode_minus": True,
    "figure.constrained_layout.h_pad": 0.03,
    "figure.constrained_layout.w_pad": 0.03,
    "figure.facecolor": COLOURS["paper"],
    "font.size": 7.0,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.5,
    "legend.fontsize": 6.6,
    "legend.frameon": False,
    "legend.handlelength": 1.5,
    "lines.linewidth": 0.9,
    "lines.markersize": 3.0,
    "pdf.fonttype": 42,
    "savefig.facecolor": COLOURS["paper"],
    "svg.fonttype": "path",
    "svg.hashsalt": "fit",
    "text.color": COLOURS["ink"],
    "text.usetex": False,
    "xtick.color": COLOURS["muted"],
    "xtick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.color": COLOURS["muted"],
    "ytick.major.size": 2.5,
    "ytick.minor.size": 1.5,
}


#: What the script of the page (templates/figure.js) has to know of an artist stands in its ``gid``: that it
#: is a curve, that it moves along when the axes are zoomed, that it is to vanish then.
_CURVE, MOVES, VANISHES = "curve ", "moves ", "vanishes "


@dataclass(frozen=True)
class Plot:
    """A figure and the numbers it draws.

    Attributes
    ----------
    figure : Figure
        The curves of it that `Curve.draw` drew can be zoomed and read off in the page.
    columns : mapping of str to sequence
        Of equal length, by name and unit: ``"f [Hz]"``.
    titles : mapping of str to str
        What to tell where the pointer rests on an element, by its ``gid``.
    """

    figure: Figure
    columns: Mapping[str, Sequence[object] | NDArray[np.generic]]
    titles: Mapping[str, str] = field(default_factory=dict)


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

    def draw(self, ax: Axes, role: str, **style: Any) -> None:
        """Draw it in the colour of a role; the page can tell its values."""
        if self.low is not None and self.high is not None:
            band = ax.fill_between(self.x, self.low, self.high, color=COLOURS[role], alpha=0.2, linewidth=0)
            band.set_gid(MOVES)
        ax.plot(self.x, self.y, color=COLOURS[role], gid=f"{_CURVE}{self.name}", **style)


def table(x: str, y: str, curves: Sequence[Curve]) -> dict[str, Array | list[str]]:
    """Return curves as the columns of a `Plot`, one below the other; `x` and `y` are heads with units."""
    columns: dict[str, Array | list[str]] = {
        "curve": [curve.name for curve in curves for _ in curve.x],
        x: np.concatenate([curve.x for curve in curves]),
        y: np.concatenate([curve.y for curve in curves]),
    }
    if any(curve.low is not None for curve in curves):
        for key in ("low", "high"):
            bounds = [getattr(curve, key) for curve in curves]
            whole = [
                np.full(c.x.size, np.nan) if b is None else b for c, b in zip(curves, bounds, strict=True)
            ]
            columns[key] = np.concatenate(whole)
    return columns


def _style() -> Any:
    return {**_STYLE, **figure_fonts.style()}


def drawn(draw: Callable[..., Plot], *arguments: object) -> Plot:
    """Return a figure in the style of the report; `draw` is called with `arguments`."""
    with mpl.rc_context(_style()):
        return draw(*arguments)


def svg(plot: Plot) -> str:
    """Return a figure as an SVG document, the same for the same figure."""
    with mpl.rc_context(_style()):
        text = io.StringIO()
        plot.figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    # A hundredth of a point is finer than any screen; a third of the file is digits beyond it.
    document = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text.getvalue())
    document = re.sub(r'<g id="(curve|moves|vanishes) ', r'<g data-\1="', document)
    for i, ax in enumerate(plot.figure.axes, start=1):
        if f'id="axes_{i}"' in document and any(str(line.get_gid()).startswith(_CURVE) for line in ax.lines):
            told = escape(json.dumps(_frame(ax), ensure_ascii=False))
            document = document.replace(f'<g id="axes_{i}"', f'<g id="axes_{i}" data-axes="{told}"', 1)
    return _with_titles(document, plot.titles)


def _frame(ax: Axes) -> dict[str, object]:
    """Return where the axes are in the SVG [pt], top left corner and size, and what they measure."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    width, height = 72 * figure.get_size_inches()
    place = ax.get_position()
    box = (place.x0 * width, (1 - place.y1) * height, place.width * width, place.height * height)
    frame: dict[str, object] = {"box": [round(float(side), 3) for side in box]}
    for key, axis in (("x", ax.xaxis), ("y", ax.yaxis)):
        label, _, unit = axis.get_label_text().rstrip("]").partition("  [")
        frame[key] = {
            # fewer digits than sums of products in whatever order agree in
            "limits": [float(f"{limit:.9g}") for limit in axis.get_view_interval()],
            "log": axis.get_scale() == "log",
            "label": label,
            "unit": unit,
            "ticks": bool(axis.get_tick_params()[f"label{'bottom' if key == 'x' else 'left'}"]),
        }
    return frame


def save(plot: Plot, path: Path) -> None:
    """Write a figure alone, in the format that the suffix of `path` tells."""
    with mpl.rc_context(_style()):
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
    with mpl.rc_context(_style()):
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


def _with_titles(document: str, titles: Mapping[str, str]) -> str:
    return re.sub(
        r'<g id="([\w-]+)">',
        lambda g: g[0] + (f"<title>{escape(titles[g[1]])}</title>" if g[1] in titles else ""),
        document,
    )


def inline(document: str, name: str, description: str) -> str:
    """Return an SVG document as an element for a page: scalable, described, its colours CSS variables.

    Parameters
    ----------
    document : str
        From `write`.
    name : str
        Unique in the page, letters and digits; keeps the ids of several figures apart.
    description : str
        Alternative text: plain words, no markup.
    """
    root, body = document[document.index("<svg") :].split(">", maxsplit=1)
    view_box = re.findall(r'viewBox="[^"]*"', root)[0]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r'(\bid="|href="#|url\(#)', rf"\1{name}-", body)
    for role, colour in COLOURS.items():
        body = body.replace(colour, f"var(--{role})")
    return f'<svg {view_box} role="img" aria-label="{description}">{body}'


def column(height: float, rows: int = 1, legend: int = 1) -> tuple[Figure, list[Axes]]:
    """Return a figure of one column with axes above each other, all with the same margins in all figures.

    To have the margins measured is what takes longest in drawing.

    Parameters
    ----------
    height : float
        Of every row, with the lines of its legend but without what is below the last [inch].
    rows, legend : int
        Number of axes, and of lines above each.
    """
    left, right, bottom, line = 0.5, 0.12, 0.34, 0.14
    total = rows * height + bottom
    figure = Figure(figsize=(WIDTH, total))
    size = ((WIDTH - left - right) / WIDTH, (height - legend * line - 0.1) / total)
    places = [(left / WIDTH, (bottom + (rows - 1 - i) * height) / total, *size) for i in range(rows)]
    axes = [figure.add_axes(place) for place in places]
    for ax in axes[:-1]:
        ax.sharex(axes[-1])
        ax.tick_params(labelbottom=False)
    for ax in axes:
        ax.yaxis.set_label_coords(-0.36 / (size[0] * WIDTH), 0.5)
    return figure, axes


def loglog(ax: Axes, band: tuple[float, float]) -> None:
    """Make an axis that of amplitude spectral densities of accelerations."""
    for axis, scale in ((ax.xaxis, ax.set_xscale), (ax.yaxis, ax.set_yscale)):
        scale("log")
        axis.set_major_locator(LogLocator(numticks=9))
        axis.set_major_formatter(FuncFormatter(_power))
        axis.set_minor_formatter(NullFormatter())
    ax.set_xlim(*band)
    ax.set_xlabel("frequency  [Hz]")
    ax.set_ylabel("ASD  [m s⁻²/√Hz]")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.grid(visible=True, which="minor", linewidth=0.25)


def _power(value: float, _: object) -> str:
    """Return a power of ten in print."""
    digits = str(round(math.log10(value))).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{digits}"


def legend_above(ax: Axes, columns: int) -> None:
    """Put the legend of an axis above its right end, clear of the curves."""
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1.0), ncols=columns, borderaxespad=0.1, columnspacing=1.4)
