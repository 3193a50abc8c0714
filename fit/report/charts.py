"""Figures as elements of the page: what the script draws from."""

import base64
import json
import re
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from numpy.typing import NDArray

from fit.figures import Axis, Chart, Curve, Note, Panel, Points, Span
from fit.report.section import FigureSpec, RenderedFigure

Array = NDArray[np.float64]

ENVIRONMENT = Environment(
    loader=PackageLoader("fit.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_SHORT = 64  # numbers that are written out


def render(spec: FigureSpec) -> RenderedFigure:
    """Return a figure as the page has it."""
    figure = spec.draw()
    element = figure if isinstance(figure, Markup) else _chart(figure, spec.description)
    return RenderedFigure(element, spec.caption, spec.name)


def _chart(chart: Chart, description: str) -> Markup:
    """Return a place for a chart, with its numbers for the script."""
    arrays = _Arrays()
    panels = [_panel(panel, arrays) for panel in chart.panels]
    document = {"panels": panels, "arrays": arrays.encoded}
    # in a script, only this could end it
    data = json.dumps(document, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    return element("chart", Markup(data), description)


def element(kind: str, *arguments: object) -> Markup:
    """Return a figure as an element of the page, made by one of the macros of ``figures.html.jinja``."""
    module: Any = ENVIRONMENT.get_template("figures.html.jinja").module
    return Markup(getattr(module, kind)(*arguments).strip())


class _Arrays:
    """Arrays of a figure, each once: short ones as numbers, long ones as float32 in base64."""

    def __init__(self) -> None:
        self.encoded: list[object] = []
        self._known: dict[bytes, int] = {}

    def add(self, values: Array, factor: float) -> int:
        """Return where an array is."""
        scaled = np.ascontiguousarray(values, dtype=np.float64) * factor
        key = scaled.tobytes()
        if key not in self._known:
            self._known[key] = len(self.encoded)
            self.encoded.append(self._written(scaled))
        return self._known[key]

    @staticmethod
    def _written(values: Array) -> object:
        if values.size <= _SHORT:
            return [float(f"{v:.12g}") if np.isfinite(v) else None for v in values]
        return base64.b64encode(values.astype("<f4").tobytes()).decode()


def _panel(panel: Panel, arrays: _Arrays) -> dict[str, Any]:
    """Return a panel as the script reads it."""
    factor = _factor(panel.y, panel.up)
    return {
        "title": html(panel.title),
        "height": panel.height,
        "x": _axis(panel.x, panel.across, 1.0),
        "y": _axis(panel.y, panel.up, factor),
        "marks": [_mark(mark, arrays, factor) for mark in panel.marks],
    }


def _factor(axis: Axis, limits: tuple[float, float]) -> float:
    """Return the factor that makes the smallest or largest number about 1."""
    size = limits[0] if axis.log else max(map(abs, limits))
    return 1.0 if size == 0 or 1e-3 < size < 1e6 else float(10.0 ** -np.floor(np.log10(size)))


def _axis(axis: Axis, limits: tuple[float, float], factor: float) -> dict[str, Any]:
    return {**vars(axis), "limits": [float(f"{limit * factor:.12g}") for limit in limits], "factor": factor}


def _mark(mark: Curve | Points | Span | Note, arrays: _Arrays, factor: float) -> dict[str, Any]:
    """Return a mark as the script reads it, along y in units of `factor`."""
    document: dict[str, Any] = {"kind": type(mark).__name__.lower()}
    along_y = {"y", "low", "high"} if not isinstance(mark, Span) or mark.along == "y" else set()
    for name, value in vars(mark).items():
        scale = factor if name in along_y else 1.0
        if isinstance(value, np.ndarray):
            document[name] = arrays.add(value, scale)
        else:
            document[name] = value * scale if isinstance(value, float) else value
    return document | ({} if isinstance(mark, Note) else {"label": html(mark.label)})


def html(label: str) -> Markup:
    """Return a label with its subscripts."""
    return Markup(re.sub(r"_(\S+)", r"<sub>\1</sub>", str(escape(label))))
