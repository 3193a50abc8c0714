"""The time axis of a run: where it is even to the bit, three numbers stand for it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.telemetry.pieces import Row, pieces


@dataclass(frozen=True)
class _Even:
    start: float
    fs: float
    size: int
    first: int = 0  # that is kept, of those from `start` on

    def __getitem__(self, at: slice) -> NDArray[np.float64]:
        begin, end, step = at.indices(self.size)
        found = np.arange(self.first + begin, self.first + end, step, dtype=np.float64)
        found /= self.fs
        found += self.start
        return found


class TimeAxis:
    """The `time` of a run, an array that is made when it is asked for: of weeks, it fills the memory."""

    def __get__(self, run: Any, _: type | None = None) -> NDArray[np.float64]:
        if run is None:
            raise AttributeError("time: of a run, not of its class")
        return part(run, slice(None))

    def __set__(self, run: Any, time: Row) -> None:
        run.__dict__["time"] = time if isinstance(time, _Even) else _kept(time, run.fs)


def part(run: Any, at: slice) -> NDArray[np.float64]:
    """Return some of the instants [s] of a run."""
    return np.asarray(row(run)[at])


def axis_part(run: Any, at: slice) -> Row:
    """Return the same as a row: what is not made of an even axis takes no memory."""
    of_run, (begin, end, step) = row(run), at.indices(size(run))
    if not isinstance(of_run, _Even) or step != 1:
        return of_run[at]
    return replace(of_run, size=max(end - begin, 0), first=of_run.first + begin)


def row(run: Any) -> Row:
    """Return all of them, to be had part by part."""
    kept: Row = run.__dict__["time"]
    return kept


def size(run: Any) -> int:
    """Return how many samples a run has, without its time axis."""
    return row(run).size


def _kept(time: Row, fs: float) -> Row:
    if not time.size:
        return time
    even = _Even(float(time[:1][0]), fs, time.size)
    same = all(np.array_equal(time[piece], even[piece]) for piece in pieces(time.size))
    return even if same else time[:]
