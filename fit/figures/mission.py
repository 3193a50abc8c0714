"""Figures of what the experiments say together: gain over time, residuals, correlations."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy import stats

from fit.estimate import SCORES
from fit.figures.files import COLOURS, WIDE, WIDTH, Plot, legend_above
from fit.results import Diagnostics, Estimate

Array = NDArray[np.float64]

_COLUMNS = 5  # panels beside each other
_LONGEST = 20  # letters of a name beside the matrix
_GAP = 0.06  # between the cells of a matrix, in cells


@dataclass(frozen=True)
class GainPoint:
    """A gain as one experiment alone found it, and when; `leaning` where that took the joint fit's help."""

    start: np.datetime64
    gain: Estimate
    leaning: bool


def gain_evolution(points: Sequence[GainPoint], joint: Estimate | None) -> Plot:
    """Draw lambda_2 of every experiment against its date, with the joint value and its 1-sigma band."""
    figure = Figure(figsize=(WIDTH, 2.3), layout="constrained")
    ax = figure.subplots()
    points = sorted(points, key=lambda p: p.start)
    when: NDArray[np.generic] = np.array([p.start for p in points])
    if np.unique(when).size < when.size:  # dates that nobody cared for
        when = np.arange(1, when.size + 1)
        ax.set_xlabel("experiment")
    else:
        ticks = AutoDateLocator(maxticks=6)  # type: ignore[no-untyped-call]
        ax.xaxis.set_major_locator(ticks)
        ax.xaxis.set_major_formatter(ConciseDateFormatter(ticks))  # type: ignore[no-untyped-call]
        ax.set_xlabel("start of run  [UTC]")
    if joint is not None:
        band = (joint.value - joint.sigma, joint.value + joint.sigma)
        ax.axhspan(*band, color=COLOURS["blue"], alpha=0.25, linewidth=0)
        ax.axhline(joint.value, color=COLOURS["blue"], linestyle="--", label="joint fit, ±1 σ")
    for leaning, label in ((False, "each experiment alone"), (True, "single tone")):
        kept = [i for i, p in enumerate(points) if p.leaning == leaning]
        if kept:
            ax.errorbar(
                when[kept],
                [points[i].gain.value for i in kept],
                [points[i].gain.sigma for i in kept],
                fmt="o",
                color=COLOURS["ink"],
                markerfacecolor=COLOURS["paper"] if leaning else COLOURS["ink"],
                markersize=3.0,
                elinewidth=0.7,
                capsize=1.8,
                label=label,
            )
    ax.ticklabel_format(axis="y", useOffset=False)
    ax.set_ylabel("λ₂  [1]")
    legend_above(ax, columns=3)
    return Plot(
        figure,
        {
            "start": [str(p.start) for p in points],
            "lambda_2 [1]": [p.gain.value for p in points],
            "sigma [1]": [p.gain.sigma for p in points],
            "single tone": [str(p.leaning).lower() for p in points],
        },
    )


def quantiles(diagnostics: Mapping[str, Diagnostics], sizes: Mapping[str, int]) -> Plot:
    """Draw how far the quantiles of normalised residuals lie off those of a normal variable, a panel each.

    Parameters
    ----------
    diagnostics : mapping of str to Diagnostics
        By experiment.
    sizes : mapping of str to int
        Number of residuals, which sets the band that 95 % of normal samples keep to at every quantile.
    """
    columns = min(_COLUMNS, len(diagnostics))
    rows = math.ceil(len(diagnostics) / columns)
    figure = Figure(figsize=(WIDE if columns > 2 else WIDTH, 1.05 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    tail = stats.norm.cdf(-np.abs(SCORES))
    reach, spreads = 0.6, {}
    for ax, (name, found) in zip(panels.flat, diagnostics.items(), strict=False):
        spreads[name] = spread = 1.96 * np.sqrt(tail * (1 - tail) / sizes[name]) / stats.norm.pdf(SCORES)
        departure = np.array(found.quantiles) - SCORES
        reach = max(reach, 1.1 * float(np.max(np.abs(departure))))
        ax.fill_between(SCORES, -spread, spread, color=COLOURS["grey"], alpha=0.3, linewidth=0)
        ax.axhline(0, color=COLOURS["muted"], linewidth=0.5)
        ax.plot(SCORES, departure, "o-", color=COLOURS["blue"], markersize=1.8, linewidth=0.5)
        ax.set_title(name, fontsize=7, parse_math=False)
        ax.set_xticks([-3, 0, 3], ["−3", "0", "3"])
        ax.set_ylim(-reach, reach)
    for ax in panels.flat[len(diagnostics) :]:
        ax.set_visible(False)
    figure.supxlabel("quantile of a normal variable  [σ]", fontsize=7)
    figure.supylabel("residual −\nnormal quantile  [σ]", fontsize=7, multialignment="center")
    return Plot(
        figure,
        {
            "experiment": [name for name in diagnostics for _ in SCORES],
            "normal quantile [sigma]": np.tile(SCORES, len(diagnostics)),
            "residual - normal quantile [sigma]": np.concatenate(
                [np.array(found.quantiles) - SCORES for found in diagnostics.values()]
            ),
            "half width of 95 % band [sigma]": np.concatenate(list(spreads.values())),
        },
    )


def correlations(names: Sequence[str], labels: Sequence[str], matrix: Array) -> Plot:
    """Draw the lower half of a correlation matrix, blue positive and orange negative.

    Parameters
    ----------
    names, labels : sequence of str
        Plain names, and mathematical text or plain names again, one for every row.
    matrix : ndarray, shape (P, P)
        From -1 to 1.
    """
    P = len(labels)
    labels = [x if x.startswith("$") or len(x) <= _LONGEST else f"{x[: _LONGEST - 1]}…" for x in labels]
    figure = Figure(figsize=(WIDTH, WIDTH - 0.1), layout="constrained")
    ax = figure.subplots()
    ax.grid(visible=False)
    for i in range(P):
        for j in range(i):
            role = "blue" if matrix[i, j] > 0 else "orange"
            _cell(ax, (j, i - 1), COLOURS[role], abs(float(matrix[i, j])), f"cell-{i}-{j}")
    steps = np.linspace(-1, 1, 9)
    size = max(0.32 * (P - 1) / 9, 0.1)
    for k, r in enumerate(steps):
        at = (P - 1.5 + (k - 9) * size, -0.4 + size)
        _cell(ax, at, COLOURS["blue" if r > 0 else "orange"], abs(r), None, size)
    for k, text in ((0, "−1"), (4, "0"), (8, "1")):
        x = P - 1.5 + (k - 8.5) * size
        ax.text(x, -0.4 + 1.75 * size, text, ha="center", va="top", fontsize=6, color=COLOURS["muted"])
    size = 6.8 if P <= 16 else max(2.0, 108 / P)
    rotation = 90 if P > 8 else 0
    ax.set_xticks(range(P - 1), labels[:-1], rotation=rotation, color=COLOURS["ink"], fontsize=size)
    ax.set_yticks(range(P - 1), labels[1:], color=COLOURS["ink"], fontsize=size)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_xlim(-0.5, P - 1.5)
    ax.set_ylim(P - 1.5, -0.5)
    ax.set_aspect("equal")
    pairs = [(i, j) for i in range(P) for j in range(i)]
    r = [float(matrix[pair]) for pair in pairs]
    titles = {
        f"cell-{i}-{j}": f"{names[j]}, {names[i]}: {value:.4f}".replace("-", "−")
        for (i, j), value in zip(pairs, r, strict=True)
    }
    return Plot(
        figure, {"row": [names[i] for i, _ in pairs], "column": [names[j] for _, j in pairs], "r": r}, titles
    )


def _cell(
    ax: Axes, centre: tuple[float, float], colour: str, share: float, gid: str | None, size: float = 1.0
) -> None:
    """Draw a square whose colour is as strong as `share`, from 0 to 1."""
    side = size - _GAP * size
    corner = (centre[0] - side / 2, centre[1] - side / 2)
    ax.add_patch(Rectangle(corner, side, side, facecolor=COLOURS["grid"], alpha=0.35, linewidth=0))
    ax.add_patch(Rectangle(corner, side, side, facecolor=colour, alpha=share, linewidth=0, gid=gid))
