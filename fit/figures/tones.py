"""Figure of the tones of a design: what tones would tell by frequency, and what those chosen are for."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fit.figures.charts import FREQUENCY, Axis, Chart, Curve, Mark, Panel, Points, limits

Array = NDArray[np.float64]
Chosen = tuple[str, float, Mapping[str, float]]

_INFORMATION = Axis("told by one tone", "", "information, relative to what is wanted", log=True)
_GROWN = Axis("growth without it", "%", "growth of sigma without the tone [%]", log=True)
_SMALLEST = 0.1  # %, where tones stand that shape the wave alone
_RANGE = 1e-6  # of the largest information, that is shown
_GROUPS = {  # by the beginning of a parameter's name: words, label, role
    "lambda": ("gains", "λ", "blue"),
    "C": ("delays", "C", "orange"),
    "delta": ("leakage", "δifo", "violet"),
    "": ("stiffness", "ω², α", "green"),
}


def tones(frequency: Array, information: Mapping[str, Array], chosen: Sequence[Chosen]) -> Chart:
    """Draw what tones tell.

    Parameters
    ----------
    frequency : ndarray, shape (N,)
        Hz.
    information : mapping of str to ndarray, shape (N,)
        By parameter, what a tone at its limits would tell.
    chosen : sequence of tuple
        The tones: where, frequency [Hz], and by parameter how many times as large its sigma would be without,
        the largest first.
    """
    across = (float(frequency[0]), float(frequency[-1]))
    marks_above: list[Mark] = []
    for group, (words, label, role) in _GROUPS.items():
        of_group = [x for name, x in information.items() if _group(name) == group]
        if of_group:
            largest = np.max(of_group, axis=0)
            marks_above.append(Curve(name=words, label=label, role=role, x=frequency, y=largest))
    marks_below: list[Mark] = []
    for group, (words, _, role) in {**_GROUPS, "none": ("waveform", "", "grey")}.items():
        rows = [(name, f, *_largest(grown)) for name, f, grown in chosen]
        rows = [row for row in rows if row[3] == group]
        if rows:
            marks_below.append(_points(f"tones for {words}", role, [row[:3] for row in rows]))
    top = max(float(mark.y.max()) for mark in marks_above if isinstance(mark, Curve))
    up = (top * _RANGE, 2 * top)
    return Chart(
        (
            Panel(FREQUENCY, _INFORMATION, tuple(marks_above), across, up, 1.9),
            Panel(FREQUENCY, _GROWN, tuple(marks_below), across, limits(_GROWN, marks_below), 1.6),
        )
    )


def _group(name: str) -> str:
    return next(group for group in _GROUPS if name.startswith(group))


def _largest(grown: Mapping[str, float]) -> tuple[float, str]:
    """Return the largest growth [%] and the group of its parameter."""
    if not grown:
        return _SMALLEST, "none"
    name, factor = next(iter(grown.items()))
    return max(100 * (factor - 1), _SMALLEST), _group(name)


def _points(name: str, role: str, rows: Sequence[tuple[str, float, float]]) -> Points:
    y = np.array([grown for _, _, grown in rows])
    x = np.array([f for _, f, _ in rows])
    return Points(name=name, label="", role=role, x=x, y=y, low=y, high=y, names=[n for n, _, _ in rows])
