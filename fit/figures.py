"""The figures of the report, as SVG; with `fit.report` the only user of matplotlib."""

import io
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fit import dynamics, spectra
from fit.parameters import stiffness
from fit.results import Estimate, Fit
from fit.telemetry import Telemetry

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
_STYLE: Any = {  # rc parameters
    "axes.edgecolor": COLOURS["muted"],
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": COLOURS["ink"],
    "axes.linewidth": 0.8,
    "axes.titlecolor": COLOURS["ink"],
    "axes.titlelocation": "left",
    "axes.titlesize": 10.0,
    "axes.unicode_minus": True,
    "figure.constrained_layout.use": True,
    "figure.facecolor": COLOURS["paper"],
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.7,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.facecolor": COLOURS["paper"],
    "svg.fonttype": "path",
    "svg.hashsalt": "fit",
    "text.color": COLOURS["ink"],
    "text.usetex": False,
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
}
WIDTH = 5.0  # inch: letters stay readable when the figure shrinks to the width of a telephone
_BUCKETS = 500  # per curve over time
_BINS_PER_DECADE = 24


def svg(draw: Callable[..., Figure], *arguments: object) -> str:
    """Return a figure as a complete SVG document, the same for the same arguments."""
    with mpl.rc_context(_STYLE):
        figure = draw(*arguments)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    # A hundredth of a point is finer than any screen; a third of the file is digits beyond it.
    return re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text.getvalue())


def inline(document: str, name: str, description: str) -> str:
    """Return an SVG document as an element for a page: scalable, described, its colours CSS variables.

    Parameters
    ----------
    document : str
        From `svg`.
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


def responses(run: Telemetry) -> Figure:
    """Draw what was injected and how o_1, o_12 (and a commanded f_x_1) responded, against time."""
    panels = [("o_1", "drag-free loop", 1e9, "nm"), ("o_12", "suspension loop", 1e9, "nm")]
    if np.nanmax(np.abs(run.channels["f_x_1"])) > 0:
        panels.append(("f_x_1", "force on test mass 1", 1e12, "pm s$^{-2}$"))
    figure = Figure(figsize=(WIDTH, 1.65 * len(panels) + 0.2))
    axes: list[Axes] = list(figure.subplots(len(panels), 1, sharex=True))
    hours = (run.time - run.time[0]) / 3600
    for ax, (channel, title, scale, unit) in zip(axes, panels, strict=True):
        symbol = _math(channel)
        curves = [(symbol, COLOURS["blue"], envelope(hours, scale * run.channels[channel]))]
        if f"guidance_{channel}" in run.channels:
            guidance = envelope(hours, scale * run.channels[f"guidance_{channel}"])
            curves.append(("guidance injected", COLOURS["orange"], guidance))
        # Least ink on top, so that neither hides the other.
        ink = [float(np.nansum(np.abs(np.diff(values)))) for _, _, (_, values) in curves]
        for (label, colour, curve), amount in zip(curves, ink, strict=True):
            ax.plot(*curve, color=colour, label=label, linewidth=1.0, zorder=3 - amount / max(*ink, 1e-300))
        ax.set_title(title)
        ax.set_ylabel(f"{symbol}  [{unit}]")
        legend_above(ax, columns=2)
    axes[-1].set_xlabel("time since start of run  [h]")
    axes[-1].set_xlim(0, run.duration / 3600)
    return figure


def legend_above(ax: Axes, columns: int) -> None:
    """Put the legend of an axis above its right end, clear of the curves."""
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1.0), ncols=columns, borderaxespad=0.1, columnspacing=1.4)


def _math(channel: str) -> str:
    symbol, *index = channel.split("_")
    return f"${symbol}_{{{','.join(index)}}}$"


def asd(time: Array, values: Array) -> tuple[Array, Array]:
    """Return frequency [Hz] and amplitude spectral density, averaged over logarithmic bins.

    The run's mean and slope are removed; the window and its notches at missing samples are those of the fit.

    Parameters
    ----------
    time : ndarray, shape (N,)
        Uniform [s].
    values : ndarray, shape (N,)
        NaN where samples are missing.
    """
    valid = np.isfinite(values)
    u = (time - time[0]) / (time[-1] - time[0])
    line = np.polynomial.Polynomial.fit(u[valid], values[valid], 1)
    spectrum = spectra.transform(
        np.where(valid, values - line(u), 0.0)[:, None], valid, (time.size - 1) / (time[-1] - time[0])
    )
    power = np.abs(spectrum.columns[:, 0]) ** 2
    bins = np.unique(np.floor(_BINS_PER_DECADE * np.log10(spectrum.f)), return_inverse=True)[1]
    count = np.bincount(bins)
    return np.bincount(bins, spectrum.f) / count, np.sqrt(np.bincount(bins, power) / count)


def acceleration(run: Telemetry, noise: Telemetry | None, parameters: Mapping[str, float]) -> Figure:
    """Draw the ASD of the injected signal o_12'', of the residual Delta g and of the noise run's Delta g.

    Parameters
    ----------
    run, noise : Telemetry
        The experiment and its noise run, if there is one.
    parameters : mapping
        Those of `fit.dynamics.residual`.
    """
    figure = Figure(figsize=(WIDTH, 3.5))
    ax = figure.subplots()
    # With every parameter zero nothing but the second derivative of the read-out is left.
    curves = [("blue", r"signal $\ddot o_{12}$", dynamics.residual(run, {}), 1.4)]
    if noise is not None:
        curves.append(("grey", r"$\Delta g$ of the noise run", dynamics.residual(noise, parameters), 2.2))
    curves.append(("orange", r"residual $\Delta g$", dynamics.residual(run, parameters), 1.2))
    for role, label, series, width in curves:
        f, density = asd(*series)
        ax.loglog(f, density, color=COLOURS[role], label=label, linewidth=width)
    ax.set_xlim(1e-4, spectra.F_MAX)
    ax.set_xlabel("frequency  [Hz]")
    ax.set_ylabel(r"ASD  [m s$^{-2}$ Hz$^{-1/2}$]")
    ax.grid(visible=True, which="minor", linewidth=0.35)
    legend_above(ax, columns=3)
    return figure


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


def stiffness_against_authority(points: Sequence[StiffnessPoint], joint: Fit | None) -> Figure:
    """Draw omega2_2 against F_max_2: each experiment alone, the joint fit's model, and their distance."""
    points = sorted(points, key=lambda p: (p.F_max_2, p.N_max_2))
    F = 1e12 * np.array([p.F_max_2 for p in points])
    reach = 1.06 * max(*F, 1.0)
    models = [found for p in points if (found := reconstruction(joint, p.F_max_2, p.N_max_2))]
    figure = Figure(figsize=(WIDTH, 4.2 if models else 3.0))
    ratios = (2, 1) if models else (1,)
    axes = figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios, squeeze=False)[:, 0]
    alone = 1e7 * np.array([(p.omega2_2.value, p.omega2_2.sigma) for p in points])
    dots = {"fmt": "o", "color": COLOURS["ink"], "markersize": 4, "elinewidth": 1.0, "zorder": 3}
    axes[0].errorbar(F, *alone.T, capsize=2.5, label="each experiment alone", **dots)
    axes[0].set_ylabel(r"$\omega^2_2$  [$10^{-7}$ s$^{-2}$]")
    if models:
        squares = {"fmt": "s", "color": COLOURS["orange"], "markersize": 8, "markerfacecolor": "none"}
        axes[0].errorbar(
            F, *1e7 * np.array(models).T, capsize=5, label="joint fit (eq. stiff_model)", **squares
        )
        for N_max in sorted({p.N_max_2 for p in points}):
            ends = [found[0] for f in (0.0, 1e-12 * reach) if (found := reconstruction(joint, f, N_max))]
            axes[0].plot([0, reach], 1e7 * np.array(ends), color=COLOURS["orange"], linewidth=0.7, alpha=0.6)
            at = {"textcoords": "offset points", "color": COLOURS["muted"], "fontsize": 8, "va": "center"}
            axes[0].annotate(f"{1e12 * N_max:.3g} pN m", (reach, 1e7 * ends[1]), (4, 0), **at)
        _pulls(axes[1], points, joint, F, reach)
    legend_above(axes[0], columns=2)
    axes[-1].set_xlabel(r"force authority $F_{\rm max,2}$  [pN]")
    axes[-1].set_xlim(-0.05 * reach, reach)
    return figure


def _pulls(ax: Axes, points: Sequence[StiffnessPoint], joint: Fit | None, F: Array, reach: float) -> None:
    """Draw how many sigma each experiment lies off the model, those of equal authority side by side."""
    for i, point in enumerate(points):
        pull = stiffness_pull(point, joint)
        if pull is not None:
            twins = np.flatnonzero(F[i] == F)
            x = F[i] + 0.014 * reach * (i - twins.mean())
            ax.plot([x, x], [0, pull], color=COLOURS["ink"], linewidth=1.0, zorder=3)
            ax.plot(x, pull, "o", color=COLOURS["ink"], markersize=4, zorder=3)
    ax.axhspan(-1, 1, color=COLOURS["grid"], alpha=0.7, linewidth=0)
    ax.axhline(0, color=COLOURS["muted"], linewidth=0.8)
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, -2.5), max(high, 2.5))
    ax.set_ylabel("alone − joint\n[σ]")
