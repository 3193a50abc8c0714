"""Figure of the gain of test mass 2 by date: experiments, their mean, and the joint fit."""

from collections.abc import Mapping

import numpy as np

from fit.figures.charts import (
    START,
    Axis,
    Chart,
    Curve,
    Dash,
    Limits,
    Mark,
    Panel,
    Span,
    limits,
    measured,
    posix,
)
from fit.fitting import weighted_mean
from fit.results import Estimate

_EXPERIMENT = Axis("experiment", "", "start")
_GAIN = Axis("λ₂", "", "lambda_2 [1]")


def gain_evolution(gains: Mapping[str, tuple[np.datetime64, Estimate]], joint: Estimate | None) -> Chart:
    """Draw lambda_2 of every experiment against its date, with their mean and the joint value.

    Parameters
    ----------
    gains : mapping of str to (datetime64, Estimate)
        Start and gain, by experiment.
    joint : Estimate or None
        Of the joint fit.
    """
    names = sorted(gains, key=lambda name: gains[name][0])
    axis, when = START, posix([gains[name][0] for name in names])
    if np.unique(when).size < when.size:  # dates without meaning
        axis, when = _EXPERIMENT, np.arange(1.0, when.size + 1)
    estimates = [gains[name][1] for name in names]
    values = np.array([(gain.value, gain.sigma) for gain in estimates])
    points = measured("each experiment alone", when, values, names)
    across = limits(axis, [points], key="x")
    marks: list[Mark] = []
    if len(estimates) > 1:
        mean = weighted_mean(estimates)
        label = f"their mean (χ²/ν = {mean.chi2_red:.3g})"
        marks += _level(label, "green", ":", across, mean.mean, mean.sigma)
    if joint is not None:
        marks += _level("joint fit, ±1 σ", "blue", "--", across, joint.value, joint.sigma)
    marks.append(points)
    return Chart((Panel(axis, _GAIN, tuple(marks), across, limits(_GAIN, marks), 2.0),))


def _level(
    label: str, role: str, dash: Dash, across: Limits, value: float, sigma: float
) -> tuple[Span, Curve]:
    """Return a value for all, with the band of its sigma."""
    shade = Span(low=value - sigma, high=value + sigma, role=role, opacity=0.2, along="y")
    x, y = np.array(across), np.full(2, value)
    return shade, Curve(name=label, label=label, role=role, x=x, y=y, dash=dash)
