"""Shapes of glitches in Delta g, and the columns that take them out of a run.

In flight a glitch was a double exponential that lasted seconds to hours (arXiv 2205.11938): one-sided where
it carried an impulse, of two signs where it carried none. The shapes are those and what rises before it
falls, of any two times; added up as often as it takes, they come as close to other ones as the noise can
tell. Each is made from its transform, so that it begins between samples and holds nothing beyond the fitted
band that could be folded into it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.signal import Spectrum, derivatives

Array = NDArray[np.float64]

#: By name, the transform as a function of ``s = 2 pi i f tau`` but for the factor ``1 / (1 + q s)`` of the
#: other time: what is pushed and falls, what is pushed back, what rises and ends.
KINDS: Mapping[str, Callable[[Spectrum], Spectrum]] = {
    "pushed": lambda s: 1 / (1 + s),
    "swinging": lambda s: s / (1 + s),
    "rising": lambda s: 1 / (1 - s),
}
#: What is looked for first, with the other time over tau, q: ``exp(-t)``, ``t exp(-t)``, its derivative
#: ``(1 - t) exp(-t)``, ``exp(t)`` that ends, and ``exp(-|t|)``; t is in units of tau since the begin.
SOUGHT = (("pushed", 0.0), ("pushed", 1.0), ("swinging", 1.0), ("rising", 0.0), ("pushed", -1.0))
LEAST = {"swinging": 0.02}  # q; -1 where nothing is said
LASTS = 4.0  # tau after the begin until which a glitch is said to last
PER_DECADE = 3  # of tau: the ratio falls by 2 % at most between two
SHORTEST = 30.0  # s, tau; what is shorter is masked
LONGEST = 10800.0  # s, tau
SHARE = 0.25  # of a run, that tau may take: what is longer passes for a drift


@dataclass(frozen=True)
class Shape:
    """One of the `KINDS`, its tau [s], and its other time over that: before the begin if negative."""

    kind: str
    tau: float
    other: float = 0.0

    def transform(self, f: Array) -> Spectrum:
        """Return the transform of the shape that begins at zero, at the frequencies f [Hz], shape (B,)."""
        s = np.asarray(2j * np.pi * self.tau * f, dtype=np.complex128)
        return np.asarray(KINDS[self.kind](s) / (1 + self.other * s), dtype=np.complex128)

    def turned(self, by: float) -> "Shape":
        """Return the shape whose other time is longer by so much, in tau, as far as that goes."""
        return replace(self, other=float(np.clip(self.other + by, LEAST.get(self.kind, -1.0), 1.0)))


@dataclass(frozen=True)
class Glitch:
    """A shape that begins `begin` [s] after the start of the run."""

    shape: Shape
    begin: float

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end [s] of where it is notable."""
        reach, q = LASTS * self.shape.tau, self.shape.other
        before, after = (1.0, q) if self.shape.kind == "rising" else (-q, 1.0)
        return self.begin - reach * max(before, 0.0), self.begin + reach * max(after, 0.0)

    def series(self, time: Array, fs: float) -> Array:
        """Return it at the evenly spaced instants `time` [s], shape (N,), no higher than about 1."""
        n = scipy.fft.next_fast_len(time.size + int(2 * LASTS * self.shape.tau * fs), real=True)
        f, smooth = _low_pass(n, fs)
        spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
        late = -2 * np.pi * f * (self.begin - time[0])
        inside = spectrum[: f.size]
        inside.real, inside.imag = np.cos(late), np.sin(late)
        inside *= self.shape.transform(f)
        inside *= smooth
        found = np.asarray(scipy.fft.irfft(spectrum, n), dtype=np.float64)[: time.size]
        return found * (fs * self.shape.tau)


@lru_cache(maxsize=4)  # a shape that is moved and turned keeps its length for a while
def _low_pass(n: int, fs: float) -> tuple[Array, Array]:
    """Return the frequencies [Hz] of the transform of n samples up to where nothing is left, and what is."""
    f = scipy.fft.rfftfreq(n, 1 / fs)
    smooth = np.exp(-((f / (2 * min(derivatives.F_MAX, fs / 10))) ** 4))
    kept = int(np.count_nonzero(smooth))
    for shared in (f, smooth):
        shared.setflags(write=False)  # others get the same ones
    return f[:kept], smooth[:kept]


def bounds(duration: float) -> tuple[float, float]:
    """Return the least and the largest tau [s] to look for in a run that lasts so many seconds."""
    return SHORTEST, max(SHORTEST, min(LONGEST, SHARE * duration))


def bank(duration: float) -> list[Shape]:
    """Return the shapes to look for in a run that lasts so many seconds."""
    shortest, longest = bounds(duration)
    steps = int(PER_DECADE * np.log10(longest / shortest))
    taus = shortest * 10 ** (np.arange(steps + 1) / PER_DECADE)
    return [Shape(kind, float(tau), q) for tau in taus for kind, q in SOUGHT]


def columns(found: Sequence[Glitch], time: Array, fs: float) -> Array:
    """Return the glitches at the instants `time` [s], shape (N, number of glitches)."""
    return np.stack([glitch.series(time, fs) for glitch in found], axis=1)
