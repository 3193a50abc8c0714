"""Covariance of the scores of a run whose noise variance changes within the run."""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.whitening import whitened_run

Array = NDArray[np.float64]
#: Ends of a frequency band [Hz], and the variance in equal segments of the run over that of the whole run.
SegmentVariances = tuple[tuple[float, float, Array], ...]


@dataclass(frozen=True)
class NonstationaryRun(whitened_run.WhitenedRun):
    """A whitened run whose noise variance changes within the run.

    Attributes
    ----------
    segment_variances : tuple of tuple
        Ends of each band [Hz] in which it does, and the variance in equal segments of the run, shape (S,),
        over the mean under the window.
    """

    segment_variances: SegmentVariances = field(default=(), kw_only=True)

    @cached_property
    def M(self) -> Array:
        """As that of `WhitenedRun`: the time series of each band is scaled by its standard deviations."""
        if not self.segment_variances:
            return super().M
        assert self.window is not None and self.f is not None
        bands = [
            ((self.f > low) & (self.f <= high), variance) for low, high, variance in self.segment_variances
        ]
        M = self._band_covariance(~np.any([bins for bins, _ in bands], axis=0), self.window)
        for bins, variance in bands:
            segment = np.arange(self.window.size) * variance.size // self.window.size
            M = M + self._band_covariance(bins, self.window * np.sqrt(variance[segment]))
        return M

    def _band_covariance(self, bins: NDArray[np.bool_], window: Array) -> Array:
        """Return the covariance of the scores of some bins under a window, shape (K, K)."""
        run = {x.name: getattr(self, x.name) for x in fields(whitened_run.WhitenedRun)}
        weights = replace(self.weights, score=self.weights.score * bins)
        return whitened_run.WhitenedRun(**run | {"weights": weights, "window": window}).M


def with_segment_variances(
    run: whitened_run.WhitenedRun, segment_variances: SegmentVariances
) -> NonstationaryRun:
    """Return a whitened run with noise of these variances."""
    run_fields = {x.name: getattr(run, x.name) for x in fields(whitened_run.WhitenedRun)}
    return NonstationaryRun(**run_fields, segment_variances=segment_variances)
