"""Figures of what the experiments say together: gain over time, stiffness, residuals, correlations."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fit.estimate import SCORES
from fit.figures.charts import (
    Axis,
    Chart,
    Columns,
    Curve,
    Limits,
    Mark,
    Matrix,
    Note,
    Panel,
    Points,
    Shape,
    Span,
    limits,
)
from fit.paper import stiffness, stiffness_terms
from fit.results import Diagnostics, Estimate, Fit

Array = NDArray[np.float64]

_COLUMNS = 5  # panels beside each other
_START = Axis("start of run", "UTC", "start", dates=True)
_EXPERIMENT = Axis("experiment", "", "start")
_GAIN = Axis("λ₂", "1", "lambda_2 [1]")
_AUTHORITY = Axis("force authority of test mass 2", "pN", "F_max_2 [pN]")
_STIFFNESS = Axis("ω²₂", "10⁻⁷ s⁻²", "omega2_2 [1e-7 s-2]")
_PULL = Axis("alone − joint", "σ", "(alone - joint) / sigma")
_QUANTILE = Axis("quantile of a normal variable", "σ", "normal quantile [sigma]")
_DEPARTURE = Axis("residual − normal quantile", "σ", "residual - normal quantile [sigma]")


@dataclass(frozen=True)
class GainPoint:
    """A gain as an experiment alone found it, and when; `leaning` where that took the joint fit's help."""

    name: str
    start: np.datetime64
    gain: Estimate
    leaning: bool


def gain_evolution(points: Sequence[GainPoint], joint: Estimate | None) -> Chart:
    """Draw lambda_2 of every experiment against its date, with the joint value and its 1-sigma band."""
    points = sorted(points, key=lambda p: p.start)
    axis, when = _START, np.array([p.start for p in points]).astype("datetime64[ms]").astype(float) / 1e3
    if np.unique(when).size < when.size:  # dates that nobody cared for
        axis, when = _EXPERIMENT, np.arange(1.0, when.size + 1)
    own: list[Mark] = []
    kinds: tuple[tuple[bool, Shape, str], ...] = (
        (False, "dot", "each experiment alone"),
        (True, "ring", "single tone"),
    )
    for leaning, mark, label in kinds:
        kept = [i for i, p in enumerate(points) if p.leaning == leaning]
        if kept:
            gains = np.array([(points[i].gain.value, points[i].gain.sigma) for i in kept])
            names = [points[i].name for i in kept]
            own.append(_measured(label, when[kept], gains, names, mark=mark))
    across = limits(axis, own, key="x")
    marks = own
    if joint is not None:
        low, high = joint.value - joint.sigma, joint.value + joint.sigma
        shade = Span(low=low, high=high, role="blue", opacity=0.25, along="y")
        level = np.full(2, joint.value)
        line = Curve(
            name="joint fit", label="joint fit, ±1 σ", role="blue", x=np.array(across), y=level, dash="--"
        )
        marks = [shade, line, *own]
    told: Columns = {
        "experiment": [p.name for p in points],
        _START.head: [str(p.start) for p in points],
        _GAIN.head: [p.gain.value for p in points],
        "sigma [1]": [p.gain.sigma for p in points],
        "single tone": [str(p.leaning).lower() for p in points],
    }
    return Chart((Panel(axis, _GAIN, tuple(marks), across, limits(_GAIN, marks), 2.0),), told)


def _measured(label: str, x: Array, values: Array, names: Sequence[str], mark: Shape = "dot") -> Points:
    """Return values with their sigmas, shape (N, 2), as marks with error bars."""
    y, sigma = values.T
    role = "orange" if mark == "square" else "ink"
    return Points(
        name=label, label=label, role=role, x=x, y=y, low=y - sigma, high=y + sigma, names=names, mark=mark
    )


@dataclass(frozen=True)
class StiffnessPoint:
    """omega2_2 [s-2] as an experiment alone found it, and its authority F_max_2 [N], N_max_2 [N m].

    `in_joint` tells whether the experiment took part in the joint fit.
    """

    name: str
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


def stiffness_against_authority(points: Sequence[StiffnessPoint], joint: Fit | None) -> Chart:
    """Draw omega2_2 against F_max_2: each experiment alone, the joint fit's model, and their distance."""
    points = sorted(points, key=lambda p: (p.F_max_2, p.N_max_2))
    names = [p.name for p in points]
    F = 1e12 * np.array([p.F_max_2 for p in points])
    reach = 1.06 * max(*F, 1.0)
    models = [found for p in points if (found := reconstruction(joint, p.F_max_2, p.N_max_2))]
    alone = 1e7 * np.array([(p.omega2_2.value, p.omega2_2.sigma) for p in points])
    marks: list[Mark] = [_measured("each experiment alone", F, alone, names)]
    told: Columns = {
        "experiment": names,
        _AUTHORITY.head: F,
        "N_max_2 [pN m]": [1e12 * p.N_max_2 for p in points],
        _STIFFNESS.head: alone[:, 0],
        "sigma [1e-7 s-2]": alone[:, 1],
    }
    across = (-0.05 * reach, reach)
    below = []
    if models:
        of_joint = 1e7 * np.array(models)
        pulls = [stiffness_pull(p, joint) for p in points]
        marks += [
            _measured("joint fit", F, of_joint, names, mark="square"),
            *_model(joint, sorted({p.N_max_2 for p in points}), reach),
        ]
        below = [_pulls(pulls, F, names, across)]
        told |= {
            f"joint {_STIFFNESS.head}": of_joint[:, 0],
            "joint sigma [1e-7 s-2]": of_joint[:, 1],
            _PULL.head: [math.nan if pull is None else pull for pull in pulls],
        }
    above = Panel(_AUTHORITY, _STIFFNESS, tuple(marks), across, limits(_STIFFNESS, marks), 1.85)
    return Chart((above, *below), told)


def _model(joint: Fit | None, torques: Sequence[float], reach: float) -> list[Mark]:
    """Return eq. stiff_model as the joint fit has it against F_max [pN], a line for each N_max [N m]."""
    marks: list[Mark] = []
    for N_max in torques:
        ends = [found[0] for f in (0.0, 1e-12 * reach) if (found := reconstruction(joint, f, N_max))]
        torque = f"{1e12 * N_max:.3g} pN m"
        x, y = np.array([0.0, reach]), 1e7 * np.array(ends)
        marks.append(Curve(name=torque, label="", role="orange", x=x, y=y, width=0.5, opacity=0.6))
        marks.append(Note(text=torque, x=reach, y=float(y[-1])))
    return marks


def _pulls(pulls: Sequence[float | None], F: Array, names: Sequence[str], across: Limits) -> Panel:
    """Return how many sigma each experiment lies off the model, those of equal authority side by side."""
    known = np.array([i for i, pull in enumerate(pulls) if pull is not None], dtype=int)
    twins = [np.flatnonzero(F[i] == F) for i in known]
    aside = 0.014 * across[1] * np.array([i - t.mean() for i, t in zip(known, twins, strict=True)])
    y = np.array([pulls[i] for i in known], dtype=float)
    stems = Points(
        name="pull", label="", role="ink", x=F[known] + aside, y=y, low=np.minimum(y, 0),
        high=np.maximum(y, 0), names=[names[i] for i in known], caps=False,
    )  # fmt: skip
    shade = Span(low=-1, high=1, role="grid", opacity=0.7, along="y")
    level = Curve(name="zero", label="", role="muted", x=np.array(across), y=np.zeros(2), width=0.6)
    marks = (shade, level, stems)
    low, high = limits(_PULL, marks)
    return Panel(_AUTHORITY, _PULL, marks, across, (min(low, -2.5), max(high, 2.5)), 0.95)


def quantiles(diagnostics: Mapping[str, Diagnostics], sizes: Mapping[str, int]) -> Chart:
    """Draw how far the quantiles of normalised residuals lie off those of a normal variable, a panel each.

    Parameters
    ----------
    diagnostics : mapping of str to Diagnostics
        By experiment.
    sizes : mapping of str to int
        Number of residuals, which sets the band that 95 % of normal samples keep to at every quantile.
    """
    tail = stats.norm.cdf(-np.abs(SCORES))
    density = stats.norm.pdf(SCORES)
    spreads = [1.96 * np.sqrt(tail * (1 - tail) / sizes[name]) / density for name in diagnostics]
    departures = [np.array(found.quantiles) - SCORES for found in diagnostics.values()]
    reach = max(0.6, *(1.1 * float(np.max(np.abs(departure))) for departure in departures))
    across = (1.05 * float(SCORES[0]), 1.05 * float(SCORES[-1]))
    panels = []
    for name, spread, departure in zip(diagnostics, spreads, departures, strict=True):
        band = Curve(
            name="95 % band", label="", role="grey", x=SCORES, y=np.zeros(SCORES.size), low=-spread,
            high=spread, width=0.5,
        )  # fmt: skip
        dots = Curve(name=name, label="", role="blue", x=SCORES, y=departure, width=0.5, dots=True)
        panels.append(Panel(_QUANTILE, _DEPARTURE, (band, dots), across, (-reach, reach), 1.05, name))
    told: Columns = {
        "experiment": [name for name in diagnostics for _ in SCORES],
        _QUANTILE.head: np.tile(SCORES, len(diagnostics)),
        _DEPARTURE.head: np.concatenate(departures),
        "half width of 95 % band [sigma]": np.concatenate(spreads),
    }
    return Chart(tuple(panels), told, beside=min(_COLUMNS, len(diagnostics)))


def correlations(joint: Fit) -> Matrix:
    """Return the correlation matrix of a joint fit, with the lower half of it as a table."""
    names, matrix = list(joint), joint.correlation
    pairs = [(i, j) for i in range(len(names)) for j in range(i)]
    r = [float(matrix[pair]) for pair in pairs]
    told: Columns = {"row": [names[i] for i, _ in pairs], "column": [names[j] for _, j in pairs], "r": r}
    return Matrix(tuple(names), matrix, told)
