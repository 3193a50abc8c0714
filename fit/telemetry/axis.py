"""The time axis of a run: where it is even to the bit, three numbers stand for it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.telemetry.pieces import Row, pieces


@dataclass(frozen=True)
class _Even:
    start: float
    fs: float
    size: int

    def __getitem__(self, at: slice) -> NDArray[np.float64]:
        found = np.arange(*at.indices(self.size), dtype=np.float64)
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
