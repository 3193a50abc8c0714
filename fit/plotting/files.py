"""Figures for print as files: SVG, PDF, and CSV with the numbers that are drawn."""

import base64
import csv
import io
import logging
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as MatplotlibFigure
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.figures import Chart
from fit.files import atomic
from fit.parallel import update_progress
from fit.plotting import panels
from fit.plotting.style import STYLE

#: Axes of matplotlib to draw on, one for each panel; None for a new figure.
PlotAxes: TypeAlias = Axes | Sequence[Axes] | None
SCREEN_SCALE = 2.2  # of a figure one column wide in a journal
logging.getLogger("fontTools").setLevel(logging.WARNING)  # it logs every glyph


@dataclass(frozen=True, repr=False)
class Plot:
    """A figure and the numbers it draws; a notebook shows it.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        As matplotlib has it.
    columns : mapping of str to sequence
        Of equal length, by name and unit: ``"f [Hz]"``.
    """

    figure: MatplotlibFigure
    columns: Mapping[str, Sequence[object] | NDArray[np.generic]]

    def __repr__(self) -> str:
        return f"<Plot of {', '.join(self.columns)}: {len(next(iter(self.columns.values()), ()))} rows>"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the figure as it is in the report. The suffix gives the format: pdf, svg or png."""
        with mpl.rc_context(STYLE):
            self.figure.savefig(path)

    def svg(self) -> str:
        """Return the figure as an SVG document, the same for the same figure."""
        with mpl.rc_context(STYLE):
            text = io.StringIO()
            self.figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        # A hundredth of a point is finer than any screen; a third of the file is digits beyond it.
        return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text.getvalue())

    def _repr_html_(self) -> str:
        """Return an image on white, for any colour scheme of the notebook."""
        data = base64.b64encode(self.svg().encode()).decode()
        width = round(96 * SCREEN_SCALE * self.figure.get_figwidth())
        return f'<img src="data:image/svg+xml;base64,{data}" style="width:{width}px;max-width:100%" alt="">'


def draw(figure: Chart, ax: PlotAxes = None) -> Plot:
    """Draw a figure in the style of a journal, or its panels on axes of yours.

    Raises
    ------
    InputError
        If there are not as many axes as panels.
    """
    if ax is not None:
        axes = [ax] if isinstance(ax, Axes) else list(ax)
        if len(axes) != len(figure.panels) or not all(isinstance(one, Axes) for one in axes):
            raise InputError(f"plot: ax: {shown(ax)}, expected {len(figure.panels)} axes of matplotlib")
        panels.draw_on(axes, figure)
        canvas = axes[0].get_figure(root=True)
        assert canvas is not None
        return Plot(canvas, figure.columns)
    with mpl.rc_context(STYLE):
        drawing = panels.draw(figure)
    return Plot(drawing, figure.columns)


def write(folder: Path, name: str, function: Callable[..., Plot], *arguments: object) -> None:
    """Write NAME.svg, NAME.pdf and NAME.csv, the same bytes for the same arguments.

    Progress is reported in three steps of about equal duration.

    Parameters
    ----------
    folder : Path
        An existing one.
    function : callable
        Called with `arguments` in the style of a journal.
    """
    with mpl.rc_context(STYLE):
        plot = function(*arguments)
        update_progress(1 / 3)
        document = plot.svg()
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
