"""Figures for print as files: SVG, PDF, and CSV with the numbers that are drawn."""

import csv
import io
import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure as Drawn
from numpy.typing import NDArray

from fit.figures import Figure, Matrix
from fit.files import atomic
from fit.parallel import update_progress
from fit.plotting import matrix, panels
from fit.plotting.style import STYLE

logging.getLogger("fontTools").setLevel(logging.WARNING)  # it logs every glyph


@dataclass(frozen=True)
class Plot:
    """A figure and the numbers it draws.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        As matplotlib has it.
    columns : mapping of str to sequence
        Of equal length, by name and unit: ``"f [Hz]"``.
    """

    figure: Drawn
    columns: Mapping[str, Sequence[object] | NDArray[np.generic]]


def drawn(figure: Figure) -> Plot:
    """Draw a figure in the style of a journal."""
    with mpl.rc_context(STYLE):
        drawing = matrix.drawn(figure) if isinstance(figure, Matrix) else panels.drawn(figure)
    return Plot(drawing, figure.columns)


def svg(plot: Plot) -> str:
    """Return a figure as an SVG document, the same for the same figure."""
    with mpl.rc_context(STYLE):
        text = io.StringIO()
        plot.figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    # A hundredth of a point is finer than any screen; a third of the file is digits beyond it.
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text.getvalue())


def save(plot: Plot, path: Path) -> None:
    """Write a figure alone, in the format of the suffix of `path`."""
    with mpl.rc_context(STYLE):
        plot.figure.savefig(path)


def write(folder: Path, name: str, draw: Callable[..., Plot], *arguments: object) -> None:
    """Write NAME.svg, NAME.pdf and NAME.csv, the same bytes for the same arguments.

    Progress is reported in three steps of about equal duration.

    Parameters
    ----------
    folder : Path
        An existing one.
    draw : callable
        Called with `arguments` in the style of a journal.
    """
    with mpl.rc_context(STYLE):
        plot = draw(*arguments)
        update_progress(1 / 3)
        document = svg(plot)
        update_progress(2 / 3)
        plot.figure.set_layout_engine("none")  # the layout is fixed: the second file is cheaper
        nothing = {"CreationDate": None, "Creator": None, "Producer": None}
        pdf = io.BytesIO()
        plot.figure.savefig(pdf, format="pdf", metadata=nothing)
    for suffix, content in (("pdf", pdf.getvalue()), ("svg", document), ("csv", _table(plot))):
        atomic.write(folder / f"{name}.{suffix}", content)


def _table(plot: Plot) -> str:
    table = io.StringIO()
    lines = csv.writer(table, lineterminator="\n")
    lines.writerow(plot.columns)
    lines.writerows(zip(*(map(_cell, column) for column in plot.columns.values()), strict=True))
    return table.getvalue()


def _cell(value: object) -> str:
    """Return a cell of a table; one without a number is empty."""
    if isinstance(value, float | np.floating):
        return f"{value:.8g}" if np.isfinite(value) else ""
    return str(value)
