"""A gain that changes within a run: it drifts with time, or walks at random."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals.noise import Source
from lpfcosim.signals.seeding import generator
from lpfcosim.spacecraft import Run

STEP = 60.0  # s, of a random walk; straight in between
DAY = 86_400.0  # s

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GainDrift(Source):
    """Relative change of a gain, zero in the mean of a run.

    ``level`` is the width that a random walk has after a day [day^-0.5], ``drift`` the change a day [day^-1].
    """

    drift: float = 0.0

    def start(self, run: Run) -> "_Path":
        """Return the change at the beginning of the run."""
        return _Path(self, run)

    def psd(self, frequency: Array, h: float) -> Array:  # noqa: ARG002
        """Return zeros: a change within a run is no stationary noise."""
        return np.zeros(frequency.size)


class _Path:
    """What a gain does in a run, in blocks of any size to the same bits."""

    def __init__(self, drift: GainDrift, run: Run) -> None:
        duration = run.n_samples * run.h
        self._knots = STEP * np.arange(math.ceil(duration / STEP) + 1)
        steps = generator(run, drift.name).standard_normal(self._knots.size - 1)
        self._values = np.concatenate([[0.0], np.cumsum(drift.level * math.sqrt(STEP / DAY) * steps)])
        self._values += drift.drift * self._knots / DAY
        time = run.time
        self._values -= np.interp(time, self._knots, self._values).mean() if time.size else 0.0
        self._h, self._drawn = run.h, 0

    def take(self, n: int) -> Array:
        """Return the next ``n`` samples."""
        first_sample, self._drawn = self._drawn, self._drawn + n
        time = np.arange(first_sample, self._drawn) * self._h
        return np.asarray(np.interp(time, self._knots, self._values))
