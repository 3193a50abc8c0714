"""The time axis of a run: where it is even to the bit, three numbers stand for it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.telemetry.pieces import pieces


@dataclass(frozen=True)
class _Even:
    start: float
    fs: float
    size: int

    def instants(self, at: slice) -> NDArray[np.float64]:
        found = np.arange(*at.indices(self.size), dtype=np.float64)
        found /= self.fs
        found += self.start
        return found


class TimeAxis:
    """`Telemetry.time`, an array that is made when it is asked for: of weeks, it fills the memory."""

    def __get__(self, run: Any, _: type | None = None) -> NDArray[np.float64]:
        if run is None:
            raise AttributeError("time: of a run, not of its class")
        return part(run, slice(None))

    def __set__(self, run: Any, time: NDArray[np.float64] | _Even) -> None:
        run.__dict__["time"] = time if isinstance(time, _Even) else _kept(time, run.fs)


def part(run: Any, at: slice) -> NDArray[np.float64]:
    """Return some of the instants [s] of a run."""
    kept = run.__dict__["time"]
    return kept.instants(at) if isinstance(kept, _Even) else np.asarray(kept[at])


def size(run: Any) -> int:
    """Return how many samples a run has, without its time axis."""
    return int(run.__dict__["time"].size)


def _kept(time: NDArray[np.float64], fs: float) -> NDArray[np.float64] | _Even:
    if not time.size:
        return time
    even = _Even(float(time[0]), fs, time.size)
    same = all(np.array_equal(time[piece], even.instants(piece)) for piece in pieces(time.size))
    return even if same else time
