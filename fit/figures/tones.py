"""Figure of the tones of a design: information by frequency, and the parameters that each tone determines."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import FREQUENCY, Axis, Chart, Curve, Mark, Panel, Points, limits

Array = NDArray[np.float64]
Tone = tuple[str, float, Mapping[str, float]]

_INFORMATION = Axis("information of one tone", "", "information, relative to the goal", log=True)
_GROWTH = Axis("growth without it", "%", "growth of sigma without the tone [%]", log=True)
_SMALLEST = 0.1  # %, place of tones that only shape the waveform
_RANGE = 1e-6  # of the largest information, that is shown
_GROUPS = {  # by the beginning of a parameter's name: words, label, role
    "lambda": ("gains", "λ", "blue"),
    "C": ("delays", "C", "orange"),
    "delta": ("leakage", "δifo", "violet"),
    "": ("stiffness", "ω², α", "green"),
}


def tones(frequency: Array, information: Mapping[str, Array], design: Sequence[Tone]) -> Chart:
    """Draw the information of tones by frequency, and the effect of leaving out each tone of a design.

    Parameters
    ----------
    frequency : ndarray, shape (N,)
        Hz.
    information : mapping of str to ndarray, shape (N,)
        By parameter, the information of a tone at its limits.
    design : sequence of tuple
        The tones: where, frequency [Hz], and by parameter how many times as large its sigma would be without,
        the largest first.
    """
    across = (float(frequency[0]), float(frequency[-1]))
    information_marks: list[Mark] = []
    for group, (words, label, role) in _GROUPS.items():
        of_group = [x for name, x in information.items() if _group(name) == group]
        if of_group:
            largest = np.max(of_group, axis=0)
            information_marks.append(Curve(name=words, label=label, role=role, x=frequency, y=largest))
    growth_marks: list[Mark] = []
    for group, (words, _, role) in {**_GROUPS, "none": ("waveform", "", "grey")}.items():
        rows = [(name, f, *_largest(growth)) for name, f, growth in design]
        rows = [row for row in rows if row[3] == group]
        if rows:
            growth_marks.append(_points(f"tones for {words}", role, [row[:3] for row in rows]))
    top = max(float(mark.y.max()) for mark in information_marks if isinstance(mark, Curve))
    up = (top * _RANGE, 2 * top)
    return Chart(
        (
            Panel(FREQUENCY, _INFORMATION, tuple(information_marks), across, up, 1.9),
            Panel(FREQUENCY, _GROWTH, tuple(growth_marks), across, limits(_GROWTH, growth_marks), 1.6),
        )
    )


def _group(name: str) -> str:
    return next(group for group in _GROUPS if name.startswith(group))


def _largest(growth: Mapping[str, float]) -> tuple[float, str]:
    """Return the largest growth [%] and the group of its parameter."""
    if not growth:
        return _SMALLEST, "none"
    name, factor = next(iter(growth.items()))
    return max(100 * (factor - 1), _SMALLEST), _group(name)


def _points(name: str, role: str, rows: Sequence[tuple[str, float, float]]) -> Points:
    y = np.array([growth for _, _, growth in rows])
    x = np.array([f for _, f, _ in rows])
    return Points(name=name, label="", role=role, x=x, y=y, low=y, high=y, names=[n for n, _, _ in rows])
