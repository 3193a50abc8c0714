"""Figures of what the experiments say together: gain over time, stiffness, residuals, correlations."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy import stats

from fit.estimate import SCORES
from fit.figures.files import Axis, Columns, Plot, legend_above
from fit.figures.style import COLOURS, WIDE, WIDTH
from fit.paper import joint_parameter, stiffness, stiffness_terms
from fit.results import Diagnostics, Estimate, Fit

Array = NDArray[np.float64]

_COLUMNS = 5  # panels beside each other
_LONGEST = 20  # letters of a name beside the matrix
_GAP = 0.06  # between the cells of a matrix, in cells
_START = Axis("start of run", "UTC", "start")
_GAIN = Axis("λ₂", "1", "lambda_2 [1]")
_AUTHORITY = Axis("force authority of test mass 2", "pN", "F_max_2 [pN]")
_STIFFNESS = Axis("ω²₂", "10⁻⁷ s⁻²", "omega2_2 [1e-7 s-2]")
_PULL = Axis("alone − joint", "σ", "(alone - joint) / sigma")
_QUANTILE = Axis("quantile of a normal variable", "σ", "normal quantile [sigma]")
_DEPARTURE = Axis("residual −\nnormal quantile", "σ", "residual - normal quantile [sigma]")


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
        ax.set_xlabel(_START.title)
    if joint is not None:
        band = (joint.value - joint.sigma, joint.value + joint.sigma)
        ax.axhspan(*band, color=COLOURS["blue"], alpha=0.25, linewidth=0)
        ax.axhline(joint.value, color=COLOURS["blue"], linestyle="--", label="joint fit, ±1 σ")
    ink: Any = {"fmt": "o", "color": COLOURS["ink"], "markersize": 3.0, "elinewidth": 0.7, "capsize": 1.8}
    for leaning, face, label in ((False, "ink", "each experiment alone"), (True, "paper", "single tone")):
        kept = [i for i, p in enumerate(points) if p.leaning == leaning]
        if kept:
            gains = np.array([(points[i].gain.value, points[i].gain.sigma) for i in kept])
            ax.errorbar(when[kept], *gains.T, markerfacecolor=COLOURS[face], label=label, **ink)
    ax.ticklabel_format(axis="y", useOffset=False)
    ax.set_ylabel(_GAIN.title)
    legend_above(ax, columns=3)
    told: Columns = {
        _START.head: [str(p.start) for p in points],
        _GAIN.head: [p.gain.value for p in points],
        "sigma [1]": [p.gain.sigma for p in points],
        "single tone": [str(p.leaning).lower() for p in points],
    }
    return Plot(figure, told)


@dataclass(frozen=True)
class StiffnessPoint:
    """omega2_2 [s-2] as one experiment alone found it, and its authority F_max_2 [N], N_max_2 [N m].

    `in_joint` tells whether the experiment took part in the joint fit.
    """

    F_max_2: float
    N_max_2: float
    omega2_2: Estimate
    in_joint: bool = True


def reconstruction(joint: Fit | None, F_max: float, N_max: float) -> tuple[float, float] | None:
    """Return omega2_2 and its sigma [s-2] of the joint fit , None where it lacks a term."""
    terms = stiffness_terms(2, F_max, N_max)
    if joint is None or not joint.parameters.keys() >= terms.keys():
        return None
    order = list(joint.parameters)
    of_terms = [order.index(name) for name in terms]
    factors = np.array(list(terms.values()))
    variance = factors @ joint.covariance[np.ix_(of_terms, of_terms)] @ factors
    return stiffness(2, joint.values, F_max, N_max), math.sqrt(max(float(variance), 0.0))


def stiffness_pull(point: StiffnessPoint, joint: Fit | None) -> float | None:
    """Return in how many sigma an experiment alone differs from the joint fit's model, None without one.

    The joint fit has seen the experiment: an efficient estimate correlates with any other of the same
    quantity just so that the variance of their difference is the difference of their variances.
    """
    model = reconstruction(joint, point.F_max_2, point.N_max_2)
    if model is None:
        return None
    sign = -1 if point.in_joint else 1
    variance = point.omega2_2.sigma**2 + sign * model[1] ** 2
    return (point.omega2_2.value - model[0]) / math.sqrt(variance) if variance > 0 else None


def stiffness_against_authority(points: Sequence[StiffnessPoint], joint: Fit | None) -> Plot:
    """Draw omega2_2 against F_max_2: each experiment alone, the joint fit's model, and their distance."""
    points = sorted(points, key=lambda p: (p.F_max_2, p.N_max_2))
    F = 1e12 * np.array([p.F_max_2 for p in points])
    reach = 1.06 * max(*F, 1.0)
    models = [found for p in points if (found := reconstruction(joint, p.F_max_2, p.N_max_2))]
    pulls = [stiffness_pull(p, joint) for p in points]
    figure = Figure(figsize=(WIDTH, 3.0 if models else 2.1), layout="constrained")
    ratios = (2, 1) if models else (1,)
    axes = figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
    alone = 1e7 * np.array([(p.omega2_2.value, p.omega2_2.sigma) for p in points])
    dots = {"fmt": "o", "color": COLOURS["ink"], "markersize": 2.8, "elinewidth": 0.7, "zorder": 3}
    axes[0].errorbar(F, *alone.T, capsize=1.8, label="each experiment alone", **dots)
    axes[0].set_ylabel(_STIFFNESS.title)
    told: Columns = {
        _AUTHORITY.head: F,
        "N_max_2 [pN m]": [1e12 * p.N_max_2 for p in points],
        _STIFFNESS.head: alone[:, 0],
        "sigma [1e-7 s-2]": alone[:, 1],
    }
    if models:
        of_joint = 1e7 * np.array(models)
        squares = {"fmt": "s", "color": COLOURS["orange"], "markersize": 5.5, "markerfacecolor": "none"}
        axes[0].errorbar(F, *of_joint.T, capsize=3.5, label="joint fit (eq. stiff_model)", **squares)
        _model(axes[0], joint, sorted({p.N_max_2 for p in points}), reach)
        _pulls(axes[1], pulls, F, reach)
        told |= {
            f"joint {_STIFFNESS.head}": of_joint[:, 0],
            "joint sigma [1e-7 s-2]": of_joint[:, 1],
            _PULL.head: [math.nan if pull is None else pull for pull in pulls],
        }
    legend_above(axes[0], columns=2)
    axes[-1].set_xlabel(_AUTHORITY.title)
    axes[-1].set_xlim(-0.05 * reach, reach)
    return Plot(figure, told)


def _model(ax: Axes, joint: Fit | None, torques: Sequence[float], reach: float) -> None:
    """Draw eq. stiff_model as the joint fit has it against F_max [pN], a line for each N_max [N m]."""
    for N_max in torques:
        ends = [found[0] for f in (0.0, 1e-12 * reach) if (found := reconstruction(joint, f, N_max))]
        ax.plot([0, reach], 1e7 * np.array(ends), color=COLOURS["orange"], linewidth=0.5, alpha=0.6)
        end = (reach, 1e7 * ends[1])
        text = ax.annotate(f"{1e12 * N_max:.3g} pN m", end, (4, 0), textcoords="offset points", va="center")
        text.set(color=COLOURS["muted"], fontsize=5.8)


def _pulls(ax: Axes, pulls: Sequence[float | None], F: Array, reach: float) -> None:
    """Draw how many sigma each experiment lies off the model, those of equal authority side by side."""
    for i, pull in enumerate(pulls):
        if pull is not None:
            twins = np.flatnonzero(F[i] == F)
            x = F[i] + 0.014 * reach * (i - twins.mean())
            ax.plot([x, x], [0, pull], color=COLOURS["ink"], linewidth=0.7, zorder=3)
            ax.plot(x, pull, "o", color=COLOURS["ink"], markersize=2.8, zorder=3)
    ax.axhspan(-1, 1, color=COLOURS["grid"], alpha=0.7, linewidth=0)
    ax.axhline(0, color=COLOURS["muted"], linewidth=0.6)
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, -2.5), max(high, 2.5))
    ax.set_ylabel(f"{_PULL.label}\n[{_PULL.unit}]")


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
    density = stats.norm.pdf(SCORES)
    spreads = [1.96 * np.sqrt(tail * (1 - tail) / sizes[name]) / density for name in diagnostics]
    departures = [np.array(found.quantiles) - SCORES for found in diagnostics.values()]
    reach = max(0.6, *(1.1 * float(np.max(np.abs(departure))) for departure in departures))
    for ax, name, spread, departure in zip(panels.flat, diagnostics, spreads, departures, strict=False):
        ax.fill_between(SCORES, -spread, spread, color=COLOURS["grey"], alpha=0.3, linewidth=0)
        ax.axhline(0, color=COLOURS["muted"], linewidth=0.5)
        ax.plot(SCORES, departure, "o-", color=COLOURS["blue"], markersize=1.8, linewidth=0.5)
        ax.set_title(name, fontsize=7, parse_math=False)
        ax.set_xticks([-3, 0, 3], ["−3", "0", "3"])
        ax.set_ylim(-reach, reach)
    for ax in panels.flat[len(diagnostics) :]:
        ax.set_visible(False)
    figure.supxlabel(_QUANTILE.title, fontsize=7)
    figure.supylabel(_DEPARTURE.title, fontsize=7, multialignment="center")
    told: Columns = {
        "experiment": [name for name in diagnostics for _ in SCORES],
        _QUANTILE.head: np.tile(SCORES, len(diagnostics)),
        _DEPARTURE.head: np.concatenate(departures),
        "half width of 95 % band [sigma]": np.concatenate(spreads),
    }
    return Plot(figure, told)


def correlations(joint: Fit) -> Plot:
    """Draw the lower half of the correlation matrix of a joint fit, blue positive and orange negative."""
    names, labels, matrix = list(joint), list(map(_label, joint)), joint.correlation
    P = len(names)
    figure = Figure(figsize=(WIDTH, WIDTH - 0.1), layout="constrained")
    ax = figure.subplots()
    ax.grid(visible=False)
    pairs = [(i, j) for i in range(P) for j in range(i)]
    r = [float(matrix[pair]) for pair in pairs]
    titles = {}
    for (i, j), value in zip(pairs, r, strict=True):
        key = f"cell-{i}-{j}"
        _cell(ax, (j, i - 1), value, gid=key)
        titles[key] = f"{names[j]}, {names[i]}: {value:.4f}".replace("-", "−")
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
    told: Columns = {"row": [names[i] for i, _ in pairs], "column": [names[j] for _, j in pairs], "r": r}
    return Plot(figure, told, titles=titles)


def _label(name: str) -> str:
    """Return the symbol of a parameter, or its name as text that is no mathematics and not long."""
    with suppress(KeyError):
        return f"${joint_parameter(name).latex}$"
    short = name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
    return short.replace("$", r"\$")


def _scale(ax: Axes, P: int) -> None:
    """Draw what colour means what correlation, above the empty half of the matrix."""
    size = max(0.32 * (P - 1) / 9, 0.1)
    for k, r in enumerate(np.linspace(-1, 1, 9)):
        _cell(ax, (P - 1.5 + (k - 9) * size, -0.4 + size), float(r), size)
    for k, text in ((0, "−1"), (4, "0"), (8, "1")):
        x = P - 1.5 + (k - 8.5) * size
        ax.text(x, -0.4 + 1.75 * size, text, ha="center", va="top", fontsize=6, color=COLOURS["muted"])


def _cell(ax: Axes, centre: tuple[float, float], r: float, size: float = 1.0, gid: str | None = None) -> None:
    """Draw a square in the colour of a correlation."""
    side = size - _GAP * size
    corner = (centre[0] - side / 2, centre[1] - side / 2)
    colour = COLOURS["blue" if r > 0 else "orange"]
    ax.add_patch(Rectangle(corner, side, side, facecolor=COLOURS["grid"], alpha=0.35, linewidth=0))
    ax.add_patch(Rectangle(corner, side, side, facecolor=colour, alpha=abs(r), linewidth=0, gid=gid))
