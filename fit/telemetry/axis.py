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
    first_sample: int = 0  # that is kept, of those from `start` on

    def __getitem__(self, index: slice) -> NDArray[np.float64]:
        begin, end, step = index.indices(self.size)
        instants = np.arange(self.first_sample + begin, self.first_sample + end, step, dtype=np.float64)
        instants /= self.fs
        instants += self.start
        return instants


class TimeAxis:
    """The `time` of a run, an array that is made when it is asked for: of weeks, it fills the memory."""

    def __get__(self, run: Any, _: type | None = None) -> NDArray[np.float64]:
        if run is None:
            raise AttributeError("time: of a run, not of its class")
        return part(run, slice(None))

    def __set__(self, run: Any, time: Row) -> None:
        run.__dict__["time"] = time if isinstance(time, _Even) else _even_or_stored(time, run.fs)


def part(run: Any, part_slice: slice) -> NDArray[np.float64]:
    """Return some of the instants [s] of a run."""
    return np.asarray(row(run)[part_slice])


def axis_part(run: Any, part_slice: slice) -> Row:
    """Return the same as a row: what is not made of an even axis takes no memory."""
    of_run, (begin, end, step) = row(run), part_slice.indices(size(run))
    if not isinstance(of_run, _Even) or step != 1:
        return of_run[part_slice]
    return replace(of_run, size=max(end - begin, 0), first_sample=of_run.first_sample + begin)


def row(run: Any) -> Row:
    """Return all of them, to be had part by part."""
    stored: Row = run.__dict__["time"]
    return stored


def size(run: Any) -> int:
    """Return how many samples a run has, without its time axis."""
    return row(run).size


def _even_or_stored(time: Row, fs: float) -> Row:
    if not time.size:
        return time
    even = _Even(float(time[:1][0]), fs, time.size)
    same = all(np.array_equal(time[piece], even[piece]) for piece in pieces(time.size))
    return even if same else time[:]
