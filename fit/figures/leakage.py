"""Figure of delta_ifo, the leakage of x_1 into o_12, by alignment epoch."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fit.figures.charts import (
    Axis,
    Chart,
    Curve,
    Limits,
    Mark,
    Panel,
    Points,
    Shape,
    Span,
    aside,
    limits,
    measured,
)
from fit.parameters import DELTA_IFO_DESIGN
from fit.results import Estimate

_EPOCH = Axis("alignment epoch", "", "alignment epoch")
_LEAKAGE = Axis("δifo", "10⁻⁵", "delta_ifo [1e-5]")


def leakage(
    joint: Mapping[int, Estimate], single: Sequence[tuple[str, int, Estimate]], flight: Mapping[int, Estimate]
) -> Chart:
    """Draw delta_ifo by alignment epoch with the range that the design allows, and magnified.

    Parameters
    ----------
    joint, flight : mapping of int to Estimate
        delta_ifo_k by k, as fitted and as the flight found it.
    single : sequence of tuple
        Name, epoch and delta_ifo of every experiment on its own.
    """
    rms, limit = (1e5 * x for x in DELTA_IFO_DESIGN)
    epochs = sorted({*joint, *(epoch for _, epoch, _ in single)})
    across = (epochs[0] - 1.0, epochs[-1] + 1.0)
    allowed: list[Mark] = [
        Span(low=-rms, high=rms, role="grey", opacity=0.25, along="y", label="design, rms"),
        _line("upper limit of the design", "limits of the design", across, limit),
        _line("lower limit of the design", "", across, -limit),
    ]
    marks: list[Points] = []
    sets: list[tuple[str, str, Shape, float, list[tuple[str, int, Estimate]]]] = [
        ("flight", "orange", "square", -0.15, [("flight", k, v) for k, v in flight.items() if k in epochs]),
        ("each experiment alone", "muted", "ring", 0.15, list(single)),
        ("joint fit", "blue", "dot", 0.0, [("joint fit", k, v) for k, v in joint.items()]),
    ]
    for label, role, mark, offset, entries in sets:
        if not entries:
            continue
        k = np.array([epoch for _, epoch, _ in entries], dtype=float)
        values = 1e5 * np.array([(v.value, v.sigma) for _, _, v in entries])
        marks.append(
            measured(
                label,
                k,
                values,
                [n for n, _, _ in entries],
                mark=mark,
                role=role,
                offset=offset + aside(k, 0.05),
            )
        )
    marks_above = (*allowed, *(replace(mark, label="") for mark in marks))
    panels = (
        Panel(_EPOCH, _LEAKAGE, marks_above, across, limits(_LEAKAGE, marks_above), 1.3),
        Panel(_EPOCH, _LEAKAGE, tuple(marks), across, limits(_LEAKAGE, marks), 1.6),
    )
    return Chart(panels)


def _line(name: str, label: str, across: Limits, value: float) -> Curve:
    x, y = np.array(across), np.full(2, value)
    return Curve(name=name, label=label, role="grey", x=x, y=y, dash="--")
