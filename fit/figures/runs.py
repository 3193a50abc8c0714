"""Figures of a run and of the stiffness: responses to the injections, omega2_2 against authority."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fit.figures.files import COLOURS, WIDTH, Curve, Plot, column, legend_above, table
from fit.paper import stiffness
from fit.results import Estimate, Fit
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

_BUCKETS = 500  # per curve over time
_SUBSCRIPTS = str.maketrans("x12", "ₓ₁₂")


def envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """Return a curve of at most 2 * 500 points that covers the same ink: extremes of every bucket.

    Parameters
    ----------
    time, values : ndarray, shape (N,)
        Missing samples (NaN) are passed over; a bucket of nothing else stays a gap.
    """
    if values.size <= 2 * _BUCKETS:
        return time, values
    starts = np.linspace(0, values.size, _BUCKETS, endpoint=False).astype(int)
    extremes = np.stack([np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)], axis=1)
    extremes[1::2] = extremes[1::2, ::-1]  # up in one bucket, down in the next: a slow curve stays one
    return np.repeat(time[starts], 2), extremes.ravel()


def responses(run: Telemetry) -> Plot:
    """Draw what was injected and how o_1, o_12 (and a commanded f_x_1) responded, against time."""
    panels = [("o_1", "drag-free loop", "m"), ("o_12", "suspension loop", "m")]
    if np.nanmax(np.abs(run.channels["f_x_1"])) > 0:
        panels.append(("f_x_1", "force on test mass 1", "m s⁻²"))
    figure, axes = column(1.05, len(panels))
    hours = (run.time - run.time[0]) / 3600
    drawn: list[Curve] = []
    units: list[str] = []
    for ax, (channel, title, unit) in zip(axes, panels, strict=True):
        symbol = channel.translate(_SUBSCRIPTS).replace("_", "")
        told = [(channel, symbol, "blue"), (f"guidance_{channel}", "guidance", "orange")]
        values = {name: run.channels[name] for name, _, _ in told if name in run.channels}
        scale, prefix = _prefix(max(float(np.nanmax(np.abs(x))) for x in values.values()))
        curves = [
            (Curve(name, *envelope(hours, scale * values[name])), label, role)
            for name, label, role in told
            if name in values
        ]
        # Least ink on top, so that neither hides the other.
        ink = [float(np.nansum(np.abs(np.diff(curve.y)))) for curve, _, _ in curves]
        for (curve, label, role), amount in zip(curves, ink, strict=True):
            curve.draw(ax, role, label=label, linewidth=0.7, zorder=3 - amount / max(*ink, 1e-300))
        drawn += [curve for curve, _, _ in curves]
        units += [f"{prefix}{unit}" for curve, _, _ in curves for _ in curve.x]
        ax.set_title(title)
        ax.set_ylabel(f"{symbol}  [{prefix}{unit}]")
        legend_above(ax, columns=2)
    axes[-1].set_xlabel("time since start of run  [h]")
    axes[-1].set_xlim(0, run.duration / 3600)
    return Plot(figure, table("t [h]", "value", drawn) | {"unit": units})


def _prefix(largest: float) -> tuple[float, str]:
    """Return the factor and the prefix of the unit in which a value has one to three digits."""
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p")):
        if largest * factor >= 1:
            return factor, prefix
    return 1e15, "f"


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
    """Return omega2_2 and its sigma [s-2] of the joint fit (eq. stiff_model), None where it lacks a term."""
    names = ("omega2_2_0", "alpha_x_2", "alpha_phi_2")
    if joint is None or not joint.parameters.keys() >= set(names):
        return None
    order = list(joint.parameters)
    of_names = [order.index(name) for name in names]
    factors = np.array([1.0, F_max, N_max])
    variance = factors @ joint.covariance[np.ix_(of_names, of_names)] @ factors
    values = {name: joint.parameters[name].value for name in names}
    return stiffness(2, values, F_max, N_max), math.sqrt(max(float(variance), 0.0))


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
    axes[0].set_ylabel("ω²₂  [10⁻⁷ s⁻²]")
    if models:
        squares = {"fmt": "s", "color": COLOURS["orange"], "markersize": 5.5, "markerfacecolor": "none"}
        axes[0].errorbar(
            F, *1e7 * np.array(models).T, capsize=3.5, label="joint fit (eq. stiff_model)", **squares
        )
        for N_max in sorted({p.N_max_2 for p in points}):
            ends = [found[0] for f in (0.0, 1e-12 * reach) if (found := reconstruction(joint, f, N_max))]
            axes[0].plot([0, reach], 1e7 * np.array(ends), color=COLOURS["orange"], linewidth=0.5, alpha=0.6)
            at = {"textcoords": "offset points", "color": COLOURS["muted"], "fontsize": 5.8, "va": "center"}
            axes[0].annotate(f"{1e12 * N_max:.3g} pN m", (reach, 1e7 * ends[1]), (4, 0), **at)
        _pulls(axes[1], pulls, F, reach)
    legend_above(axes[0], columns=2)
    axes[-1].set_xlabel("force authority of test mass 2  [pN]")
    axes[-1].set_xlim(-0.05 * reach, reach)
    told: dict[str, Array | list[float]] = {
        "F_max_2 [pN]": F,
        "N_max_2 [pN m]": [1e12 * p.N_max_2 for p in points],
        "omega2_2 [1e-7 s-2]": alone[:, 0],
        "sigma [1e-7 s-2]": alone[:, 1],
    }
    if models:
        told |= {
            f"joint {key} [1e-7 s-2]": 1e7 * column
            for key, column in zip(("omega2_2", "sigma"), np.array(models).T, strict=True)
        }
        told["(alone - joint) / sigma"] = [math.nan if pull is None else pull for pull in pulls]
    return Plot(figure, told)


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
    ax.set_ylabel("alone − joint\n[σ]")
