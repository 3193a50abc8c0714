"""A correlation matrix as matplotlib draws it: the lower half, blue positive and orange negative."""

from contextlib import suppress

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from fit.figures import COLOURS, Matrix
from fit.parameters import joint_parameter
from fit.plotting.style import WIDTH

_LONGEST = 20  # letters of a name at the side of the matrix
_GAP = 0.06  # between the cells, in cells


def draw(matrix: Matrix) -> Figure:
    """Return a matrix, drawn one column wide."""
    labels = list(map(_label, matrix.names))
    P = len(labels)
    figure = Figure(figsize=(WIDTH, WIDTH - 0.1), layout="constrained")
    ax = figure.subplots()
    ax.grid(visible=False)
    for i in range(P):
        for j in range(i):
            _cell(ax, (j, i - 1), float(matrix.values[i, j]))
    _scale(ax, P)
    size = 6.8 if P <= 16 else max(2.0, 108 / P)
    rotation = 90 if P > 8 else 0
    ax.set_xticks(range(P - 1), labels[:-1], rotation=rotation, color=COLOURS["ink"], fontsize=size)
    ax.set_yticks(range(P - 1), labels[1:], color=COLOURS["ink"], fontsize=size)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_xlim(-0.5, P - 1.5)
    ax.set_ylim(P - 1.5, -0.5)
    ax.set_aspect("equal")
    return figure


def _label(name: str) -> str:
    """Return the symbol of a parameter, or its name as text that is no mathematics and not long."""
    with suppress(KeyError):
        return f"${joint_parameter(name).latex}$"
    short = name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
    return short.replace("$", r"\$")


def _scale(ax: Axes, P: int) -> None:
    """Draw the colour scale of correlations above the empty half of the matrix."""
    size = max(0.32 * (P - 1) / 9, 0.1)
    for k, r in enumerate(np.linspace(-1, 1, 9)):
        _cell(ax, (P - 1.5 + (k - 9) * size, -0.4 + size), float(r), size)
    for k, text in ((0, "−1"), (4, "0"), (8, "1")):
        x = P - 1.5 + (k - 8.5) * size
        ax.text(x, -0.4 + 1.75 * size, text, ha="center", va="top", fontsize=6, color=COLOURS["muted"])


def _cell(ax: Axes, centre: tuple[float, float], r: float, size: float = 1.0) -> None:
    """Draw a square in the colour of a correlation."""
    side = size - _GAP * size
    corner = (centre[0] - side / 2, centre[1] - side / 2)
    colour = COLOURS["blue" if r > 0 else "orange"]
    ax.add_patch(Rectangle(corner, side, side, facecolor=COLOURS["grid"], alpha=0.35, linewidth=0))
    ax.add_patch(Rectangle(corner, side, side, facecolor=colour, alpha=abs(r), linewidth=0))
