"""Matched filters of short glitches: bell curves of several widths in the whitened residual of a run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.false_alarms import sigma_limit
from fit.spectra import Spectra, Spectrum, windowing

Array = NDArray[np.float64]

WIDTHS = (0.0, 1.5, 3.0, 6.0, 12.0, 24.0)  # s, standard deviations of the bell curves
SAMPLING_LOSS = 1.2  # a series is at most 1.155 times higher between six samples in its shortest period
MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute deviation
_BATCH = 2  # transforms: faster than one by one, where all of them would fill the memory


@dataclass(frozen=True)
class MatchedFilter:
    """Signal-to-noise ratio of a short glitch at every instant of a run.

    The noise is that of the noise run, if there is one, unless the residual itself shows more, by the median
    absolute deviation of the output, which glitches hardly move.

    Attributes
    ----------
    terms : Spectra
        The run.
    residual : ndarray of complex, shape (B,)
        Its whitened residual.
    S : ndarray, shape (B,)
        PSD of the noise.
    min_sigma : float
        Least standard deviation of an output, in units of what S predicts.
    n_runs : int
        Number of runs of the campaign that are searched.
    """

    terms: Spectra
    residual: Spectrum
    S: Array
    min_sigma: float
    n_runs: int = 1

    @cached_property
    def threshold(self) -> float:
        """Signal-to-noise ratio of a glitch, for as many tests as there are runs, widths and instants."""
        return sigma_limit("matched filter", self.n_runs * len(WIDTHS) * 2 * self.terms.f.size)

    def outputs(self, n: int) -> Iterator[tuple[Array, float]]:
        """Yield the output of each filter, shape (n,), in units of noise S, and its standard deviation."""
        window, f = self.terms.window, self.terms.f
        unmasked = window[np.arange(n) * window.size // n] > 0.5
        size = n / 2 * np.sqrt(np.mean(window**2))
        for i in range(0, len(WIDTHS), _BATCH):
            widths = np.array(WIDTHS[i : i + _BATCH])
            curves = np.exp(-2 * (np.pi * widths[:, None] * f) ** 2) / np.sqrt(self.S)
            curves *= size / np.linalg.norm(curves, axis=1, keepdims=True)
            for output in windowing.inverse_transform((self.residual * curves).T, self.terms.first, n).T:
                np.abs(output, out=output)
                yield output, max(MAD_TO_SIGMA * float(np.median(output[unmasked])), self.min_sigma)

    def ratios(self) -> Iterator[Array]:
        """Yield the signal-to-noise ratio of each filter, shape (N,)."""
        for output, sigma in self.outputs(self.terms.window.size):
            output /= sigma if sigma > 0 else np.inf
            yield output

    @property
    def below_threshold(self) -> bool:
        """Whether no output exceeds the threshold, as far as a coarser sampling shows."""
        n, stop = self.terms.window.size, self.terms.first + self.terms.f.size
        outputs = self.outputs(min(scipy.fft.next_fast_len(6 * stop, real=True), n))
        return all(float(output.max()) * SAMPLING_LOSS < self.threshold * sigma for output, sigma in outputs)

    @property
    def maximum(self) -> float:
        """The largest ratio of all filters."""
        return max(float(ratio.max()) for ratio in self.ratios())

    @cached_property
    def envelope(self) -> Array:
        """The largest ratio of the filters at every instant, shape (N,)."""
        envelope = np.zeros(self.terms.window.size)
        for ratio in self.ratios():
            np.maximum(envelope, ratio, out=envelope)
        return envelope

    @property
    def narrowest_sigma(self) -> float:
        """Standard deviation of the output of the narrowest filter, in units of what S predicts."""
        return next(self.outputs(self.terms.window.size))[1]

    def widths(self, samples: Sequence[int]) -> Array:
        """Return the widths [s] of the filters with the largest ratios at these samples."""
        k = np.argmax([ratio[samples] for ratio in self.ratios()], axis=0)
        return np.asarray(np.array(WIDTHS)[k])

    def largest_output(self, stretch: slice) -> float:
        """Return the largest output in a stretch, where noise S has variance 1."""
        outputs = self.outputs(self.terms.window.size)
        return max(float(np.max(output[stretch], initial=0.0)) for output, _ in outputs)
