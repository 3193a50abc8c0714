"""Shapes of glitches in Delta g, and the columns that take them out of a run.

In flight a glitch was a double exponential that lasted seconds to hours (arXiv 2205.11938): one-sided where
it carried an impulse, of two signs where it carried none. Single exponentials, sharp and blunt, added up as
often as it takes, come as close to any of these as the noise can tell. Each is made from its transform, so
that it begins between samples and holds nothing beyond the fitted band that could be folded into it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.signal import Spectrum, derivatives

Array = NDArray[np.float64]

#: By name, the transform as a function of ``s = 2 pi i f tau``: ``exp(-t)``, ``t exp(-t)``, its derivative
#: ``(1 - t) exp(-t)``, ``exp(t)`` that ends, and ``exp(-|t|)``; t is in units of tau since the begin.
KINDS: Mapping[str, Callable[[Spectrum], Spectrum]] = {
    "sharp": lambda s: 1 / (1 + s),
    "blunt": lambda s: 1 / (1 + s) ** 2,
    "swinging": lambda s: s / (1 + s) ** 2,
    "rising": lambda s: 1 / (1 - s),
    "even": lambda s: 1 / (1 - s**2),
}
LASTS = 4.0  # tau after the begin until which a glitch is said to last
PER_DECADE = 3  # of tau: the ratio falls by 2 % at most between two
SHORTEST = 30.0  # s, tau; what is shorter is masked
LONGEST = 10800.0  # s, tau
SHARE = 0.25  # of a run, that tau may take: what is longer passes for a drift


@dataclass(frozen=True)
class Shape:
    """One of the `KINDS` and its tau [s]."""

    kind: str
    tau: float

    def transform(self, f: Array) -> Spectrum:
        """Return the transform of the shape that begins at zero, at the frequencies f [Hz], shape (B,)."""
        s = np.asarray(2j * np.pi * self.tau * f, dtype=np.complex128)
        return np.asarray(KINDS[self.kind](s), dtype=np.complex128)


@dataclass(frozen=True)
class Glitch:
    """A shape that begins `begin` [s] after the start of the run."""

    shape: Shape
    begin: float

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end [s] of where it is notable."""
        reach, kind = LASTS * self.shape.tau, self.shape.kind
        return self.begin - reach * (kind in ("rising", "even")), self.begin + reach * (kind != "rising")

    def series(self, time: Array, fs: float) -> Array:
        """Return it at the evenly spaced instants `time` [s], shape (N,), no higher than about 1."""
        n = scipy.fft.next_fast_len(time.size + int(2 * LASTS * self.shape.tau * fs), real=True)
        f = scipy.fft.rfftfreq(n, 1 / fs)
        smooth = np.exp(-((f / (2 * min(derivatives.F_MAX, fs / 10))) ** 4))
        spectrum = self.shape.transform(f) * np.exp(-2j * np.pi * f * (self.begin - time[0])) * smooth
        found = np.asarray(scipy.fft.irfft(spectrum, n), dtype=np.float64)[: time.size]
        return found * (fs * self.shape.tau)


def bounds(duration: float) -> tuple[float, float]:
    """Return the least and the largest tau [s] to look for in a run that lasts so many seconds."""
    return SHORTEST, max(SHORTEST, min(LONGEST, SHARE * duration))


def bank(duration: float) -> list[Shape]:
    """Return the shapes to look for in a run that lasts so many seconds."""
    shortest, longest = bounds(duration)
    steps = int(PER_DECADE * np.log10(longest / shortest))
    taus = shortest * 10 ** (np.arange(steps + 1) / PER_DECADE)
    return [Shape(kind, float(tau)) for tau in taus for kind in KINDS]


def columns(found: Sequence[Glitch], time: Array, fs: float) -> Array:
    """Return the glitches at the instants `time` [s], shape (N, number of glitches)."""
    return np.stack([glitch.series(time, fs) for glitch in found], axis=1)
