"""Figure of the gain of test mass 2 by date: experiments, their mean, and the joint fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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

Array = NDArray[np.float64]

_EXPERIMENT = Axis("experiment", "", "start")
_GAIN = Axis("λ₂", "", "lambda_2 [1]")


@dataclass(frozen=True)
class GainPoint:
    """The gain of a single experiment and its date."""

    name: str
    start: np.datetime64
    gain: Estimate


def gain_evolution(points: Sequence[GainPoint], joint: Estimate | None) -> Chart:
    """Draw lambda_2 of every experiment against its date, with their mean and the joint value."""
    points = sorted(points, key=lambda p: p.start)
    axis, when = START, posix([p.start for p in points])
    if np.unique(when).size < when.size:  # dates without meaning
        axis, when = _EXPERIMENT, np.arange(1.0, when.size + 1)
    single_marks: list[Mark] = []
    gains = [p.gain for p in points]
    if gains:
        values = np.array([(gain.value, gain.sigma) for gain in gains])
        names = [p.name for p in points]
        single_marks.append(measured("each experiment alone", when, values, names))
    across = limits(axis, single_marks, key="x")
    marks: list[Mark] = []
    if len(gains) > 1:
        mean = weighted_mean(gains)
        label = f"their mean (χ²/ν = {mean.chi2_red:.3g})"
        marks += _level(label, "green", ":", across, mean.mean, mean.sigma)
    if joint is not None:
        marks += _level("joint fit, ±1 σ", "blue", "--", across, joint.value, joint.sigma)
    marks += single_marks
    return Chart((Panel(axis, _GAIN, tuple(marks), across, limits(_GAIN, marks), 2.0),))


def _level(
    label: str, role: str, dash: Dash, across: Limits, value: float, sigma: float
) -> tuple[Span, Curve]:
    """Return a value for all, with the band of its sigma."""
    shade = Span(low=value - sigma, high=value + sigma, role=role, opacity=0.2, along="y")
    x, y = np.array(across), np.full(2, value)
    return shade, Curve(name=label, label=label, role=role, x=x, y=y, dash=dash)
