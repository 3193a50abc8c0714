"""Figures of a run: responses to the injections, Delta g or D, its terms, and its residual over time."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.figures.analysis import FAST, HIGHEST, SLOW, Analysis, Series
from fit.figures.charts import (
    ASD,
    FREQUENCY,
    TIME,
    Axis,
    Chart,
    Curve,
    Limits,
    Mark,
    Note,
    Panel,
    Span,
    limits,
)
from fit.figures.series import envelope, glitch_mask
from fit.model import dynamics
from fit.spacecraft import spacecraft_of
from fit.spectra import Binned, derivatives
from fit.telemetry import GUIDANCE, Telemetry

Array = NDArray[np.float64]

#: An equation of an experiment, and of its noise run, if there is one.
AnalysedPair = tuple[Analysis, Analysis | None]
_SUBSCRIPTS = str.maketrans("x12", "ₓ₁₂")
_UNITS = ("m", "m s⁻²")
LOWEST = 1e-4  # Hz, shown at most
_SIGNAL = Axis("acceleration", "pm s⁻²", "value - mean")
_RATIO = Axis("residual / noise", "", "ratio")
_RESIDUAL = Axis("residual Δg", "fm s⁻²", "value - mean")
_Style = tuple[str, Literal["-", "--", ":"]]
_STYLES: tuple[_Style, ...] = (("grey", "-"), ("violet", "-"), ("rose", "--"), ("green", "-"), ("blue", "-"))
_STYLES += (("olive", "--"), ("orange", "--"), ("cyan", ":"))
#: Symbol, colour and line of the terms of all equations.
_TERMS: Mapping[str, tuple[str, str, Literal["-", "--", ":"]]] = {
    **{term.name: (term.symbol, *style) for term, style in zip(dynamics.TERMS, _STYLES, strict=True)},
    "dds": ("s̈₁ − s̈₂", "grey", "-"),
    "K_1 s_1": ("K₁s₁", "green", "-"),
    "K_2 s_2": ("K₂s₂", "blue", "--"),
    "f_1": ("f₁", "violet", "-"),
    "f_2": ("f₂", "rose", "--"),
    "ddphi": ("φ̈", "olive", ":"),
}


def responses(run: Telemetry) -> Chart:
    """Draw the injections and the responses of the read-outs (and of a commanded f_x_1) against time."""
    read_outs = sorted(spacecraft_of(run).read_outs, key=lambda name: (name.startswith("grs"), name))
    forces = [name for name in run.channels if name == "f_x_1"]
    panels = []
    for channel in (*read_outs, *forces):
        names = [name for name in (channel, GUIDANCE.get(channel, "")) if name in run.channels]
        envelopes = {name: _hourly(run, name) for name in names}
        largest = max(float(np.nanmax(np.abs(y))) for _, y in envelopes.values())
        if channel == "f_x_1" and not largest > 0:
            continue
        scale, prefix = _prefix(largest)
        label = channel.removeprefix("grs_").translate(_SUBSCRIPTS).replace("_", "")
        y = Axis(label, f"{prefix}{_UNITS[channel in forces]}", "value")
        curves = _response(channel, y.label, envelopes, scale)
        across = (0.0, run.duration / 3600)
        panels.append(Panel(TIME, y, curves, across, limits(y, curves), 1.05))
    return Chart(tuple(panels))


def _hourly(run: Telemetry, name: str) -> tuple[Array, Array]:
    """Return hours since the start of a run, and a channel, as they are drawn."""
    time, values = envelope(run.time, run.channels[name])
    return (time - time[0]) / 3600, values


def _response(
    channel: str, label: str, envelopes: Mapping[str, tuple[Array, Array]], scale: float
) -> tuple[Curve, ...]:
    """Return a channel and its guidance, the one of least ink in front, so that neither hides the other."""
    curves = []
    for name, (x, y) in envelopes.items():
        words, role = (label, "blue") if name == channel else ("guidance", "orange")
        curves.append(Curve(name=name, label=words, role=role, x=x, y=scale * y, width=0.7))
    return tuple(sorted(curves, key=lambda curve: -float(np.nansum(np.abs(np.diff(curve.y))))))


def _prefix(largest: float) -> tuple[float, str]:
    """Return the factor and the prefix of the unit in which a value has one to three digits."""
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"), (1e12, "p")):
        if largest * factor >= 1:
            return factor, prefix
    return 1e15, "f"


def acceleration(pairs: Sequence[AnalysedPair]) -> Chart:
    """Draw the ASD of the injected signal, of the residual and of the noise run for each equation.

    Parameters
    ----------
    pairs : sequence of tuple of Analysis
        For each equation, the experiment and its noise run, if there is one.
    """
    return Chart(tuple(_acceleration(*pair, *_size(pairs, pair[0], 2.2, 1.7)) for pair in pairs))


def _size(pairs: Sequence[AnalysedPair], analysed: Analysis, one: float, several: float) -> tuple[float, str]:
    """Return height and title of the panel of an equation, which needs none if it is the only one."""
    return (one, "") if len(pairs) == 1 else (several, analysed.equation.name)


def _acceleration(run: Analysis, noise: Analysis | None, height: float, title: str) -> Panel:
    """Return a panel of signal, residual and noise."""
    name, symbol, signal = run.equation.name, run.equation.symbol, run.equation.signal
    spectra = [
        (f"signal {signal}", f"signal {_TERMS[signal][0]}", "blue", run.terms.get(signal), 0.9),
        (f"noise run {name}", f"{symbol} of the noise run", "grey", noise and noise.asd, 1.4),
        (f"residual {name}", f"residual {symbol}", "orange", run.asd, 0.8),
    ]
    curves = [
        _curve(name, label, role, width, binned) for name, label, role, binned, width in spectra if binned
    ]
    across = _shown(run.fs)
    up = limits(ASD, curves, across)
    return Panel(FREQUENCY, ASD, (*_outside(across), *curves), across, up, height, title)


def residual_over_noise(pairs: Mapping[str, tuple[Binned, Binned]]) -> Chart:
    """Draw the mean spectra of residuals and noise runs, and below the ratios of experiments and their mean.

    Parameters
    ----------
    pairs : mapping of str to tuple of Binned
        By experiment, ASD of residual and of noise run.
    """
    f = max((residual.f for residual, _ in pairs.values()), key=len)
    residuals, noises = ([_resampled(f, pair[i]) for pair in pairs.values()] for i in (0, 1))
    across = (LOWEST, derivatives.F_MAX)
    spectra = [
        _curve("noise runs", "noise runs", "grey", 1.4, _mean(f, noises)),
        _curve("residuals", "residuals", "orange", 0.9, _mean(f, residuals)),
    ]
    ratios = [_ratio(a, b) for a, b in zip(residuals, noises, strict=True)]
    style: dict[str, Any] = {"role": "grey", "width": 0.5, "opacity": 0.7}
    curves = [
        Curve(name=name, label="" if i else "each experiment", x=f, y=q.asd, **style)
        for i, (name, q) in enumerate(zip(pairs, ratios, strict=True))
    ]
    mean = _curve("mean", "all, ±1 σ", "orange", 0.9, _ratio(_mean(f, residuals), _mean(f, noises)))
    level = Curve(name="1", label="", role="ink", x=np.array(across), y=np.ones(2), width=0.6, dash="--")
    up = (0.0, min(max(limits(_RATIO, [mean], across)[1], 2.0), 10.0))
    of_spectra = Panel(FREQUENCY, ASD, tuple(spectra), across, limits(ASD, spectra, across), 1.3)
    return Chart((of_spectra, Panel(FREQUENCY, _RATIO, (*curves, mean, level), across, up, 1.1)))


def _resampled(f: Array, binned: Binned) -> Binned:
    """Return a spectrum at other frequencies, shape (B,), NaN outside its own."""
    x, outside = (np.log(f), np.log(binned.f)), {"left": np.nan, "right": np.nan}
    values = (np.exp(np.interp(*x, np.log(y), **outside)) for y in (binned.asd, binned.low, binned.high))
    return Binned(f, *values)


def _mean(f: Array, spectra: Sequence[Binned]) -> Binned:
    """Return the root of the mean power of the spectra that reach a frequency, with its error."""
    n = np.sum([np.isfinite(s.asd) for s in spectra], axis=0)
    n = np.where(n > 0, n, np.nan)
    asd = np.sqrt(np.nansum([s.asd**2 for s in spectra], axis=0) / n)
    variance = np.nansum([(s.asd * (s.high - s.low) / 2) ** 2 for s in spectra], axis=0)
    error = np.sqrt(variance) / n / asd
    return Binned(f, asd, np.maximum(asd - error, 1e-3 * asd), asd + error)


def _ratio(a: Binned, b: Binned) -> Binned:
    """Return the ratio of two spectra, with its error."""
    ratio = a.asd / b.asd
    error = ratio * np.hypot((a.high - a.low) / a.asd, (b.high - b.low) / b.asd) / 2
    return Binned(a.f, ratio, ratio - error, ratio + error)


def breakdown(pairs: Sequence[AnalysedPair]) -> Chart:
    """Draw, for each equation, the ASD of its terms and of the residual they add up to."""
    return Chart(tuple(_breakdown(run, *_size(pairs, run, 2.35, 1.8)) for run, _ in pairs))


def _breakdown(run: Analysis, height: float, title: str) -> Panel:
    """Return a panel of the terms of an equation and of its residual."""
    name, symbol = run.equation.name, run.equation.symbol
    curves = []
    for term_name, term in run.terms.items():
        label, role, dash = _TERMS[term_name]
        curve = _curve(term_name, label, role, 0.8, term)
        curves.append(replace(curve, low=None, high=None, dash=dash))  # a band for each would hide the others
    if run.asd:
        curves.append(_curve(f"residual {name}", f"residual {symbol}", "ink", 1.2, run.asd))
    across = _shown(run.fs)
    low, high = limits(ASD, curves, across)
    if run.asd and (level := run.asd.asd[run.asd.f > LOWEST]).any():
        low = float(10 ** np.floor(np.log10(0.03 * level[level > 0].min())))  # far below it nothing matters
    return Panel(FREQUENCY, ASD, (*_outside(across), *curves), across, (low, high), height, title)


def _curve(name: str, label: str, role: str, width: float, binned: Binned) -> Curve:
    """Return a spectrum with its band as a curve."""
    band: dict[str, Any] = {"low": binned.low, "high": binned.high}
    return Curve(name=name, label=label, role=role, x=binned.f, y=binned.asd, width=width, **band)


def _shown(fs: float) -> Limits:
    """Return the frequencies that spectra show [Hz]."""
    return LOWEST, min(HIGHEST, fs / 2)


def _outside(across: Limits) -> tuple[Mark, ...]:
    """Return marks of the frequencies that are not fitted."""
    end = derivatives.F_MAX
    shade = Span(low=end, high=max(end, across[1]), role="grid", opacity=0.6)
    return shade, Note(text="not fitted", x=end)


def residual(run: Telemetry, pairs: Sequence[AnalysedPair]) -> Chart:
    """Draw signal and residual of each equation over time, and magnified the residual with the noise run.

    Magnified, it is the residual less its mean: slow part, extremes of the fast one, missing samples.

    Parameters
    ----------
    run : Telemetry
        Of the experiment.
    pairs : sequence of tuple of Analysis
        For each equation, the experiment and its noise run, if there is one.

    Raises
    ------
    InputError
        If the parameters leave nothing of the run, such as a delay that is longer.
    """
    across, panels = (0.0, run.duration / 3600), []
    for analysed, noise in pairs:
        if analysed.slow is None:
            raise InputError(f"{run.path}: no data remain of the run with the parameters of the results")
        axis = replace(_RESIDUAL, label=f"residual {analysed.equation.symbol}")
        panels += _signal(analysed, across)
        panels.append(_residual(across, analysed, noise, axis, *_size(pairs, analysed, 1.4, 1.4)))
    return Chart(tuple(panels))


def _residual(
    across: Limits, analysed: Analysis, noise: Analysis | None, axis: Axis, height: float, title: str = ""
) -> Panel:
    """Return a panel of the averaged residual, the extremes of its fast part if any, and the noise run."""
    curves, unmasked = [], []
    if analysed.fast is not None:
        name = f"averaged over {FAST:g} s, extremes"
        curves.append(_smooth(name, f"{FAST:g} s", "grey", analysed.fast, 0.4))
        unmasked.append(_smoothed(analysed.fast, analysed.masked))
    if noise is not None and noise.slow is not None:
        x, y = noise.slow
        is_inside = x <= across[1]
        name = f"noise run averaged over {SLOW:g} s"
        curves.append(_smooth(name, f"noise run, {SLOW:g} s", "blue", (x[is_inside], y[is_inside]), 0.7))
        unmasked.append(_smoothed(noise.slow, noise.masked))
    if analysed.slow is not None:
        name = f"residual averaged over {SLOW:g} s"
        curves.append(_smooth(name, f"residual, {SLOW:g} s", "orange", analysed.slow, 0.8))
        unmasked.append(_smoothed(analysed.slow, analysed.masked))
    marks: tuple[Mark, ...] = (*curves, *_missing(analysed))
    return Panel(TIME, axis, marks, across, limits(axis, unmasked, across), height, title)


def _smoothed(series: Series, hours: Array) -> Curve:
    """Return a series without glitches, which may exceed the range of a panel by far."""
    x, y = series
    half_width = SLOW / 3600  # from where on averages hold it
    unmasked = np.where(glitch_mask(x, hours + np.array([-half_width, half_width])), np.nan, y)
    return Curve(name="", label="", role="", x=x, y=unmasked if np.isfinite(unmasked).any() else y)


def _signal(analysed: Analysis, across: Limits) -> list[Panel]:
    """Return the panel of the injected signal, with the residual on the same scale."""
    if analysed.signal is None or analysed.fast is None:
        return []
    (x, y), (hours, residual) = analysed.signal, analysed.fast
    term = analysed.equation.signal
    name = f"{term} averaged over {FAST:g} s"
    curves = (
        _smooth(name, f"signal {_TERMS[term][0]}, {FAST:g} s", "blue", (x, 1e-3 * y), 0.6),
        _smooth("residual on the same scale", "residual", "orange", (hours, 1e-3 * residual), 0.9),
    )
    unmasked = [_smoothed(series, analysed.masked) for series in ((x, 1e-3 * y), (hours, 1e-3 * residual))]
    return [Panel(TIME, _SIGNAL, curves, across, limits(_SIGNAL, unmasked), 1.15)]


def _smooth(name: str, label: str, role: str, series: Series, width: float) -> Curve:
    (x, y), opacity = envelope(*series), 0.7 if role == "grey" else 1.0
    return Curve(name=name, label=label, role=role, x=x, y=y, width=width, opacity=opacity)


def _missing(analysed: Analysis) -> list[Span]:
    """Return shaded intervals of missing and of masked samples."""
    spans = []
    for label, places, role in (
        ("missing samples", analysed.missing, "blue"),
        ("masked, or a glitch", analysed.masked, "violet"),
    ):
        for i, (low, high) in enumerate(places.tolist()):  # one line of the legend for all
            spans.append(
                Span(low=low, high=high, role=role, opacity=0.35, label="" if i else label, edge=0.6)
            )
    return spans
