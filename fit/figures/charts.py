"""Records of figures: axes, their marks, and the numbers in their tables.

`fit.plotting` draws these records for print, `fit.report` puts them into the page.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Limits = tuple[float, float]
Shape = Literal["dot", "square"]
Dash = Literal["-", "--", ":"]
Columns = dict[str, Sequence[object] | NDArray[np.generic]]

_ROOM = 0.05  # margin of an axis on either side, relative to its range


@dataclass(frozen=True)
class Axis:
    """What an axis measures.

    Attributes
    ----------
    label, unit : str
        On the figure, the unit in print: ``"ASD"`` and ``"m s⁻²/√Hz"``.
    head : str
        Of its column in the table, name and unit as telemetry spells it: ``"asd [m s-2 Hz-1/2]"``.
    log : bool
        Whether it is logarithmic.
    dates : bool
        Whether its numbers are seconds since 1970, UTC.
    """

    label: str
    unit: str
    head: str
    log: bool = False
    dates: bool = False

    @property
    def title(self) -> str:
        """Label and unit."""
        return f"{self.label}  [{self.unit}]" if self.unit else self.label


FREQUENCY = Axis("frequency", "Hz", "f [Hz]", log=True)
ASD = Axis("ASD", "m s⁻²/√Hz", "asd [m s-2 Hz-1/2]", log=True)
TIME = Axis("time since start of run", "h", "t [h]")
START = Axis("start of run", "UTC", "start", dates=True)


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A line.

    Attributes
    ----------
    name : str
        Plain words, for the table.
    label : str
        For the legend, with subscripts as in ``Δg_x``; empty for none.
    role : str
        Of the `COLOURS`.
    x, y : ndarray, shape (N,)
        With ascending x; NaN where there is a gap.
    low, high : ndarray, shape (N,), optional
        A band about it.
    width, opacity : float
        Of the line [pt], and from 0 to 1.
    dash : str
        ``"-"``, ``"--"`` or ``":"``.
    """

    name: str
    label: str
    role: str
    x: Array
    y: Array
    low: Array | None = None
    high: Array | None = None
    width: float = 0.9
    opacity: float = 1.0
    dash: Dash = "-"

    @property
    def names(self) -> Sequence[str]:
        """A line has no named points."""
        return ()

    @property
    def places(self) -> Array:
        """Where its points belong along x, shape (N,)."""
        return self.x


@dataclass(frozen=True, kw_only=True)
class Points:
    """Marks with error bars from `low` to `high`, and their `names`; otherwise as `Curve`.

    Those that would hide each other are drawn at an `offset` from their places, in the unit of x.
    A `mark` is a dot or a square; `caps` end the bars.
    """

    name: str
    label: str
    role: str
    x: Array
    y: Array
    low: Array
    high: Array
    names: Sequence[str] = ()
    mark: Shape = "dot"
    caps: bool = True
    offset: Array | None = None

    @property
    def places(self) -> Array:
        """Where they belong along x, shape (N,)."""
        return self.x if self.offset is None else self.x - self.offset


@dataclass(frozen=True, kw_only=True)
class Span:
    """A shaded interval along x or y; with a `label` it is in the legend."""

    low: float
    high: float
    role: str
    opacity: float
    along: Literal["x", "y"] = "x"
    label: str = ""
    edge: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Note:
    """A text next to (x, y); y is None at the lower edge."""

    text: str
    x: float
    y: float | None = None


Mark = Curve | Points | Span | Note


@dataclass(frozen=True)
class Panel:
    """Axes and their marks, from back to front.

    Attributes
    ----------
    x, y : Axis
        What they measure.
    marks : tuple of Mark
        What is drawn.
    across, up : tuple of float
        What the axes show before anybody zooms.
    height : float
        Of the panel with its legend, but without the tick labels of the last panel [inch].
    title : str
        Above it.
    """

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    across: Limits
    up: Limits
    height: float
    title: str = ""

    @property
    def lines(self) -> list[Curve | Points]:
        """What has values that can be read off."""
        return [mark for mark in self.marks if isinstance(mark, Curve | Points)]


@dataclass(frozen=True)
class Chart:
    """A figure.

    Attributes
    ----------
    panels : tuple of Panel
        Stacked with a common x axis.
    """

    panels: tuple[Panel, ...]

    @property
    def columns(self) -> Columns:
        """The numbers that the figure shows, of equal length, by name and unit: ``"f [Hz]"``.

        One curve below the other. Bounds, names of points and titles of panels have a column where there are
        any; quantity and unit, where the panels measure different ones.
        """
        drawn = {
            (panel.title, panel.y, line.name): (panel, line) for panel in self.panels for line in panel.lines
        }
        lines = [line for _, line in drawn.values()]
        heads = {(panel.y.head, panel.y.unit) for panel in self.panels}
        x = np.concatenate([line.places for line in lines])
        dates = np.asarray(1e3 * x).astype("datetime64[ms]").astype("datetime64[s]").astype(str)
        columns: Columns = {
            "curve": [line.name for line in lines for _ in line.x],
            self.panels[-1].x.head: dates if self.panels[-1].x.dates else x,
            self.panels[-1].y.head if len(heads) == 1 else "value": np.concatenate(
                [line.y for line in lines]
            ),
        }
        for key in ("low", "high"):
            bounds = [getattr(line, key) for line in lines]
            if any(bound is not None for bound in bounds):
                blank = [np.full(line.x.size, np.nan) for line in lines]
                columns[key] = np.concatenate(
                    [b if b is not None else n for b, n in zip(bounds, blank, strict=True)]
                )
        texts = {
            "name": [name for line in lines for name in line.names or [""] * line.x.size],
            "panel": [panel.title for panel, line in drawn.values() for _ in line.x],
        }
        if len(heads) > 1:
            texts["quantity"] = [panel.y.label for panel, line in drawn.values() for _ in line.x]
            texts["unit"] = [panel.y.unit for panel, line in drawn.values() for _ in line.x]
        return columns | {head: text for head, text in texts.items() if any(text)}


def force(j: int) -> Axis:
    """Return the axis of the force authority of test mass j."""
    return Axis(f"force authority of test mass {j}", "pN", f"F_max_{j} [pN]")


def measured(
    label: str, x: Array, values: Array, names: Sequence[str], *, mark: Shape = "dot", role: str = "ink"
) -> Points:
    """Return values with their sigmas, shape (N, 2), as marks with error bars."""
    y, sigma = values.T
    bars = {"low": y - sigma, "high": y + sigma, "names": names, "mark": mark}
    return Points(name=label, label=label, role=role, x=x, y=y, **bars)


def aside(x: Array, step: float) -> Array:
    """Return offsets that place marks of equal x, shape (N,), side by side, a `step` from each other."""
    twins = [np.flatnonzero(x == place) for place in x]
    return step * np.array([np.searchsorted(t, i) - (t.size - 1) / 2 for i, t in enumerate(twins)])


def posix(moments: Sequence[np.datetime64]) -> Array:
    """Return moments as an axis of dates has them."""
    return np.asarray(np.array(moments).astype("datetime64[ms]").astype(float) / 1e3, dtype=np.float64)


def limits(axis: Axis, marks: Iterable[Mark], across: Limits | None = None, *, key: str = "y") -> Limits:
    """Return the range of an axis that shows all marks, with a margin on either side.

    Parameters
    ----------
    axis : Axis
        A logarithmic one ignores values that are not positive.
    marks : iterable of Mark
        Of the panel.
    across : tuple of float, optional
        What the x axis shows: nothing else counts.
    key : str
        ``"y"``, with the bands and error bars, or ``"x"``.
    """
    values = []
    for mark in marks:
        if isinstance(mark, Curve | Points):
            shown = slice(None) if across is None else (mark.x >= across[0]) & (mark.x <= across[1])
            extent = (mark.x,) if key == "x" else (mark.y, mark.low, mark.high)
            values += [x[shown] for x in extent if x is not None]
        elif isinstance(mark, Span) and mark.along == key:
            values.append(np.array([mark.low, mark.high]))
    known = np.concatenate([np.empty(0), *values])
    known = known[np.isfinite(known) & ((known > 0) if axis.log else True)]
    if not known.size:
        return (0.1, 1.0) if axis.log else (0.0, 1.0)
    low, high = float(known.min()), float(known.max())
    if axis.log:
        room = (high / low) ** _ROOM if high > low else 10.0
        return low / room, high * room
    room = _ROOM * (high - low) if high > low else 0.5 * max(abs(high), 1e-30)
    return low - room, high + room
