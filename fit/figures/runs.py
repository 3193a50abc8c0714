"""Figures of a run: responses to the injections, Delta g, its terms, and its residual over time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.figures.files import ASD, FREQUENCY, TIME, Axis, Curve, Panel, Plot, column, legend_above, plot
from fit.figures.style import COLOURS
from fit.model import dynamics
from fit.signal import Estimator, derivatives
from fit.telemetry import Telemetry

Array = NDArray[np.float64]

_BUCKETS = 500  # per curve over time
_SUBSCRIPTS = str.maketrans("x12", "ₓ₁₂")
LOWEST, HIGHEST = 1e-4, 1.0  # Hz, shown at most
SLOW, FAST = 200.0, 20.0  # s, lengths of the windows over which the residual is averaged
_RESIDUAL = Axis("residual Δg", "fm s⁻²", "residual Delta g - mean [fm s-2]")
#: How the terms of Delta g (`dynamics.TERMS`) are drawn.
_DRAWN: Mapping[str, tuple[str, str]] = {
    "ddo_12": ("grey", "-"),
    "lambda_2 f_x_2": ("violet", "-"),
    "lambda_1 f_x_1": ("violet", "--"),
    "omega2_2 o_12": ("green", "-"),
    "domega2_12 o_1": ("blue", "-"),
    "delta_ifo ddo_1": ("blue", "--"),
    "delta_g_SC": ("orange", "--"),
    "torques": ("grey", ":"),
}


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


@dataclass(frozen=True)
class Terms:
    """Delta g of a run and what it is made of, at the rate of the file: nothing is filtered.

    Attributes
    ----------
    fs : float
        Sample rate [Hz].
    estimator : Estimator
        Of their spectra; it knows which samples are missing.
    signal, delta_g : ndarray, shape (N,)
        Second derivative of o_12, and the sum of all terms [m s^-2].
    terms : mapping of str to ndarray, each of shape (N,)
        The terms, with their signs, that are not zero throughout [m s^-2].
    """

    fs: float
    estimator: Estimator
    signal: Array
    delta_g: Array
    terms: Mapping[str, Array]


def split(telemetry: Telemetry, parameters: Mapping[str, float]) -> Terms:
    """Return the terms of Delta g.

    Parameters
    ----------
    telemetry : Telemetry
        The run.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    """
    run = dynamics.archived(telemetry)
    theta = np.array([parameters.get(name, 0.0) for name in run.parameters])
    columns = dynamics.columns(run, dynamics.delays(theta))
    terms = dynamics.terms(columns, theta)
    return Terms(
        columns.fs,
        Estimator(columns.valid, columns.fs, HIGHEST),
        columns.values[:, 0].copy(),
        dynamics.total(columns, theta),
        {name: term for name, term in terms.items() if np.any(term)},  # not where nothing is commanded
    )


def acceleration(run: Terms, noise: Terms | None) -> Plot:
    """Draw the ASD of the injected signal o_12'', of the residual Delta g and of the noise run's Delta g.

    Parameters
    ----------
    run, noise : Terms
        Of the experiment and of its noise run, if there is one.
    """
    figure, (panel,) = column(2.2, FREQUENCY, ASD)
    told = [("signal ddo_12", "signal ö₁₂", "blue", run, run.signal, 0.9)]
    if noise is not None:
        told.append(("noise run Delta g", "Δg of the noise run", "grey", noise, noise.delta_g, 1.4))
    told.append(("residual Delta g", "residual Δg", "orange", run, run.delta_g, 0.8))
    for name, label, role, of, series, width in told:
        if np.any(series):  # not of a simulation without noise
            panel.draw(_spectrum(name, series, of), role, label=label, linewidth=width)
    _band(panel, run.fs)
    legend_above(panel.ax, columns=3)
    return plot(figure, [panel])


def breakdown(run: Terms) -> Plot:
    """Draw the ASD of every term of Delta g, and of the residual they add up to."""
    figure, (panel,) = column(2.35, FREQUENCY, ASD, legend=2)
    styles = {term.name: (term.symbol, *_DRAWN[term.name]) for term in dynamics.TERMS}
    for name, term in run.terms.items():
        label, role, line = styles[name]
        found = _spectrum(name, term, run)
        curve = Curve(name, found.x, found.y)  # a band for each would hide the others
        panel.draw(curve, role, label=label, linestyle=line, linewidth=0.8)
    whole = _spectrum("residual Delta g", run.delta_g, run)
    panel.draw(whole, "ink", label="residual Δg", linewidth=1.2)
    _band(panel, run.fs)
    level = whole.y[(whole.x > LOWEST) & (whole.y > 0)]
    if level.size:  # what is far below the residual does not matter
        panel.ax.set_ylim(bottom=10 ** np.floor(np.log10(0.03 * level.min())))
    legend_above(panel.ax, columns=4)
    return plot(figure, [panel])


def _spectrum(name: str, series: Array, of: Terms) -> Curve:
    found = of.estimator.asd(series)
    return Curve(name, found.f, found.asd, found.low, found.high)


def _band(panel: Panel, fs: float) -> None:
    """Frame the spectra and mark what is not fitted."""
    ax = panel.ax
    ax.set_xlim(LOWEST, min(HIGHEST, fs / 2))
    beyond = ax.axvspan(derivatives.F_MAX, HIGHEST, color=COLOURS["grid"], alpha=0.6, linewidth=0, zorder=0)
    text = ax.text(derivatives.F_MAX, 0.02, " not fitted", transform=ax.get_xaxis_transform())
    text.set(color=COLOURS["muted"], fontsize=6)
    panel.moving.append(beyond)
    panel.vanishing.append(text)


def residual(run: Telemetry, parameters: Mapping[str, float], masked: Sequence[tuple[float, float]]) -> Plot:
    """Draw the residual Delta g less its mean: slow part, extremes of the fast one, what is missing.

    Parameters
    ----------
    run : Telemetry
        Of the experiment.
    parameters : mapping
        Those of `fit.model.dynamics.residual`.
    masked : sequence of tuple of float
        Begin and end [s] of the stretches that were masked: glitches, saturation.

    Raises
    ------
    InputError
        If the parameters leave nothing of the run, such as a delay that is longer.
    """
    time, delta_g = dynamics.residual(run, parameters)
    if not np.isfinite(delta_g).any():
        raise InputError(f"{run.path}: nothing is left of the run with the parameters of the results")
    delta_g -= np.nanmean(delta_g)
    fs = (time.size - 1) / (time[-1] - time[0])
    start = float(run.time[0])
    hours = (time - start) / 3600
    figure, (panel,) = column(1.4, TIME, _RESIDUAL)
    fine, slow = (1e15 * _averaged(delta_g, length * fs) for length in (FAST, SLOW))
    fast = Curve(f"averaged over {FAST:g} s, extremes", *envelope(hours, fine))
    every = slice(None, None, max(1, round(SLOW / 4 * fs)))
    mean = Curve(f"averaged over {SLOW:g} s", *envelope(hours[every], slow[every]))
    panel.draw(fast, "grey", label=f"{FAST:g} s", linewidth=0.4, alpha=0.7)
    panel.draw(mean, "orange", label=f"{SLOW:g} s", linewidth=0.8)
    spans = {
        "missing samples": derivatives.stretches(np.isnan(delta_g)) / fs + time[0],
        "masked": masked,
    }
    for (label, places), role in zip(spans.items(), ("blue", "violet"), strict=True):
        for begin, end in places:
            at = [(t - start) / 3600 for t in (begin, end)]
            span = panel.ax.axvspan(*at, color=COLOURS[role], alpha=0.35, linewidth=0.6, label=label)
            panel.moving.append(span)
            label = "_"  # one line of the legend for all
    panel.ax.set_xlim(0, run.duration / 3600)
    legend_above(panel.ax, columns=4)
    return plot(figure, [panel])


def _averaged(x: Array, length: float) -> Array:
    """Return `x` averaged with a Hann window of so many samples, NaN where that would reach what is missing.

    A window cut short would let through the noise of high frequencies, which the whole one averages away.
    """
    w = scipy.signal.windows.hann(max(3, round(length) | 1) + 2)[1:-1]
    known = np.isfinite(x)
    weight = scipy.signal.oaconvolve(known.astype(float), w, mode="same")
    total = scipy.signal.oaconvolve(np.where(known, x, 0.0), w, mode="same")
    return np.where(weight > 0.99 * w.sum(), total / w.sum(), np.nan)
