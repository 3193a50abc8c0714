"""Figures of a run: responses to the injections."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fit.figures.files import TIME, Axis, Curve, Panel, Plot, column, legend_above, plot
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
    shown = [("o_1", "drag-free loop", "m"), ("o_12", "suspension loop", "m")]
    if np.nanmax(np.abs(run.channels["f_x_1"])) > 0:
        shown.append(("f_x_1", "force on test mass 1", "m s⁻²"))
    ys, scales = [], []
    for channel, _, unit in shown:
        there = [run.channels[name] for name in (channel, f"guidance_{channel}") if name in run.channels]
        scale, prefix = _prefix(max(float(np.nanmax(np.abs(x))) for x in there))
        ys.append(Axis(channel.translate(_SUBSCRIPTS).replace("_", ""), f"{prefix}{unit}", "value"))
        scales.append(scale)
    figure, panels = column(1.05, TIME, *ys)
    for panel, scale, (channel, title, _) in zip(panels, scales, shown, strict=True):
        _response(panel, run, channel, scale)
        panel.ax.set_title(title)
        legend_above(panel.ax, columns=2)
    panels[-1].ax.set_xlim(0, run.duration / 3600)
    found = plot(figure, panels)
    units = [panel.y.unit for panel in panels for curve, _ in panel.curves for _ in curve.x]
    return replace(found, columns={**found.columns, "unit": units})


def _response(panel: Panel, run: Telemetry, channel: str, scale: float) -> None:
    """Draw a channel and its guidance, the one of least ink on top, so that neither hides the other."""
    hours = (run.time - run.time[0]) / 3600
    told = [(channel, panel.y.label, "blue"), (f"guidance_{channel}", "guidance", "orange")]
    curves = [
        (Curve(name, *envelope(hours, scale * run.channels[name])), label, role)
        for name, label, role in told
        if name in run.channels
    ]
    ink = [float(np.nansum(np.abs(np.diff(curve.y)))) for curve, _, _ in curves]
    for (curve, label, role), amount in zip(curves, ink, strict=True):
        panel.draw(curve, role, label=label, linewidth=0.7, zorder=3 - amount / max(*ink, 1e-300))


def _prefix(largest: float) -> tuple[float, str]:
    """Return the factor and the prefix of the unit in which a value has one to three digits."""
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p")):
        if largest * factor >= 1:
            return factor, prefix
    return 1e15, "f"
