"""A run whose noise is louder in some parts than in others, as `steadiness` finds it."""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.whitening import whitened_run

Array = NDArray[np.float64]
Steps = tuple[tuple[float, float, Array], ...]  # ends of a band [Hz], and its power in equal parts of the run


@dataclass(frozen=True)
class Unsteady(whitened_run.WhitenedRun):
    """A whitened run whose noise is louder in some parts than in others.

    Attributes
    ----------
    loud : tuple of tuple
        Bins of each band in which it is, as booleans, shape (B,), and the power in each of the equal parts of
        the run, by its mean under the window.
    """

    loud: tuple[tuple[NDArray[np.bool_], Array], ...] = field(default=(), kw_only=True)

    @cached_property
    def M(self) -> Array:
        """As that of `linear.WhitenedRun`."""
        if not self.loud:
            return super().M
        assert self.window is not None
        steady = ~np.any([bins for bins, _ in self.loud], axis=0)
        found = self._of_band(steady, self.window)
        for bins, power in self.loud:
            found = found + self._of_band(bins, self.window * np.sqrt(power[parts(self.window, power.size)]))
        return found

    def _of_band(self, bins: NDArray[np.bool_], window: Array) -> Array:
        weights = replace(self.weights, score=self.weights.score * bins)
        return whitened_run.WhitenedRun(self.tau, self.columns, weights, window, self.share, self.first).M


def parts(window: Array, count: int) -> NDArray[np.intp]:
    """Return to which of `count` equal parts of a run each sample belongs."""
    return np.arange(window.size) * count // window.size


def block(run: whitened_run.WhitenedRun, f: Array, steps: Steps) -> Unsteady:
    """Return a run with noise that is not steady, as `steadiness` has it; f [Hz] has shape (B,)."""
    own = {x.name: getattr(run, x.name) for x in fields(whitened_run.WhitenedRun)}
    return Unsteady(**own, loud=bins(f, steps))


def bins(f: Array, steps: Steps) -> tuple[tuple[NDArray[np.bool_], Array], ...]:
    """Return which of the bins f [Hz], shape (B,), are in each band, and the power in parts of the run."""
    return tuple(((f > low) & (f <= high), power) for low, high, power in steps)
