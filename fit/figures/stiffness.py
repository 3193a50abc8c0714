"""Figure of the stiffness of a test mass against its authority (Eq. (8))."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import (
    Axis,
    Chart,
    Curve,
    Limits,
    Mark,
    Note,
    Panel,
    Points,
    Span,
    aside,
    force,
    limits,
    measured,
)
from fit.parameters import stiffness, stiffness_terms
from fit.results import Estimate, Fit

Array = NDArray[np.float64]

_PULL = Axis("alone − joint", "σ", "(alone - joint) / sigma")
_SUBSCRIPTS = {1: "₁", 2: "₂"}
_ASIDE = 0.014  # of all an axis shows: between marks of one authority


def _axis(j: int) -> Axis:
    return Axis(f"ω²{_SUBSCRIPTS[j]}", "10⁻⁷ s⁻²", f"omega2_{j} [1e-7 s-2]")


@dataclass(frozen=True)
class StiffnessPoint:
    """omega2_j [s-2] of a test mass as an experiment alone found it, at its F_max_j [N] and N_max_j [N m].

    `in_joint` is whether the experiment took part in the joint fit, `F_max_other` that of the other test
    mass [N].
    """

    name: str
    j: int
    F_max: float
    N_max: float
    omega2: Estimate
    in_joint: bool = True
    F_max_other: float = 0.0


def reconstruction(joint: Fit | None, j: int, F_max: float, N_max: float) -> tuple[float, float] | None:
    """Return omega2_j and its sigma [s-2] of the joint fit, None if it is not determined."""
    terms = stiffness_terms(j, F_max, N_max)
    if joint is None:
        return None
    if not joint.parameters.keys() >= terms.keys():
        values = [s for s in joint.stiffness if (s.j, s.F_max, s.N_max) == (j, F_max, N_max)]
        return (values[0].value, values[0].sigma) if values else None
    order = list(joint.parameters)
    of_terms = [order.index(name) for name in terms]
    factors = np.array(list(terms.values()))
    variance = factors @ joint.covariance_matrix[np.ix_(of_terms, of_terms)] @ factors
    return stiffness(j, joint.values, F_max, N_max), math.sqrt(max(float(variance), 0.0))


def stiffness_pull(point: StiffnessPoint, joint: Fit | None) -> float | None:
    """Return in how many sigma an experiment alone differs from the joint fit's model, None without one.

    The joint fit has seen the experiment: an efficient estimate correlates with any other of the same
    quantity just so that the variance of their difference is the difference of their variances.
    """
    model = reconstruction(joint, point.j, point.F_max, point.N_max)
    if model is None:
        return None
    sign = -1 if point.in_joint else 1
    variance = point.omega2.sigma**2 + sign * model[1] ** 2
    return (point.omega2.value - model[0]) / math.sqrt(variance) if variance > 0 else None


def against_authority(points: Sequence[StiffnessPoint], joint: Fit | None) -> Chart:
    """Draw omega2_j against F_max_j: each experiment alone, the model, and their distance.

    Where F_max_j is the same in all experiments, against that of the other test mass, on which omega2_j does
    not depend. The model is that of the joint fit.

    Parameters
    ----------
    points : sequence of StiffnessPoint
        One or more, of one test mass.
    joint : Fit, optional
        The joint fit.
    """
    is_varied = varies(points)
    points = sorted(points, key=lambda p: (p.F_max if is_varied else p.F_max_other, p.N_max))
    j, names = points[0].j, [p.name for p in points]
    authority, axis = force(j if is_varied else 3 - j), _axis(j)
    F = 1e12 * np.array([p.F_max if is_varied else p.F_max_other for p in points])
    reach = 1.06 * max(*F, 1.0)
    models = [reconstructed for p in points if (reconstructed := reconstruction(joint, j, p.F_max, p.N_max))]
    single = 1e7 * np.array([(p.omega2.value, p.omega2.sigma) for p in points])
    marks: list[Mark] = [measured("each experiment alone", F, single, names)]
    room = aside(F, _ASIDE * reach)
    across = (min(-0.05 * reach, float((F + room).min()) - 0.02 * reach), reach)
    residual_panels = []
    if models:
        of_joint = 1e7 * np.array(models)
        pulls = [stiffness_pull(p, joint) for p in points]
        squares = measured("joint fit", F, of_joint, names, mark="square", role="orange")
        marks += [squares, *_model(joint, points, reach)]
        residual_panels = [_pulls(authority, pulls, F, names, across)]
    main_panel = Panel(authority, axis, tuple(marks), across, limits(axis, marks), 1.85)
    return Chart((main_panel, *residual_panels))


def varies(points: Sequence[StiffnessPoint]) -> bool:
    """Return whether F_max_j varies, or nothing does that could be drawn against."""
    return len({p.F_max for p in points}) > 1 or len({p.F_max_other for p in points}) == 1


def _model(joint: Fit | None, points: Sequence[StiffnessPoint], reach: float) -> list[Mark]:
    """Return Eq. (8) as the joint fit has it against F_max [pN], a line for each N_max [N m].

    Where it determines sums alone, two forces of one N_max make the line.
    """
    marks: list[Mark] = []
    for N_max in sorted({p.N_max for p in points}):
        forces = sorted({p.F_max for p in points if p.N_max == N_max})
        ends = [0.0, 1e-12 * reach] if varies(points) else [forces[0]] * 2
        models = [reconstruction(joint, points[0].j, F, N_max) for F in ends]
        if not all(models) and len(forces) > 1:
            ends = [forces[0], forces[-1]]
            models = [reconstruction(joint, points[0].j, F, N_max) for F in ends]
        known = [value for value, _ in filter(None, models)]
        if len(known) < 2:
            continue
        if ends[0] < ends[1]:
            line = np.polynomial.Polynomial.fit(ends, known, 1)
            known = [float(line(0.0)), float(line(1e-12 * reach))]
        marks += _line(N_max, reach, 1e7 * np.array(known))
    return marks


def _line(N_max: float, reach: float, ends: Array) -> tuple[Mark, ...]:
    torque = f"{1e12 * N_max:.3g} pN m"
    x = np.array([0.0, reach])
    curve = Curve(name=torque, label="", role="orange", x=x, y=ends, width=0.5, opacity=0.6)
    return curve, Note(text=torque, x=reach, y=float(ends[-1]))


def _pulls(
    authority: Axis, pulls: Sequence[float | None], F: Array, names: Sequence[str], across: Limits
) -> Panel:
    """Return how many sigma each experiment lies off the model, those of equal authority side by side."""
    known = np.array([i for i, pull in enumerate(pulls) if pull is not None], dtype=int)
    y = np.array([pulls[i] for i in known], dtype=float)
    room = aside(F[known], _ASIDE * across[1])
    bars = {"low": np.minimum(y, 0), "high": np.maximum(y, 0)}
    labels = [names[i] for i in known]
    stems = Points(
        name="pull",
        label="",
        role="ink",
        x=F[known] + room,
        y=y,
        **bars,
        names=labels,
        caps=False,
        offset=room,
    )
    shade = Span(low=-1, high=1, role="grid", opacity=0.7, along="y")
    level = Curve(name="zero", label="", role="muted", x=np.array(across), y=np.zeros(2), width=0.6)
    marks = (shade, level, stems)
    low, high = limits(_PULL, marks)
    return Panel(authority, _PULL, marks, across, (min(low, -2.5), max(high, 2.5)), 0.95)
