"""Shapes of glitches in Delta g, and the columns that take them out of a run.

In flight a glitch was a double exponential that lasted seconds to hours (arXiv 2205.11938): one-sided where
it carried an impulse, of two signs where it carried none. The shapes are those and what rises before it
falls, of any two times; added up as often as it takes, they come as close to other ones as the noise can
tell. Each is made from its transform, so that it begins between samples and holds nothing beyond the fitted
band that could be folded into it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.spectra import Spectrum, derivatives
from fit.telemetry import pieces

Array = NDArray[np.float64]

#: By name, the transform as a function of ``s = 2 pi i f tau`` and of the other time over tau, q: one-sided,
#: of two signs, reversed in time.
KINDS: Mapping[str, Callable[[Spectrum, float], Spectrum]] = {
    "double_exponential": lambda s, q: 1 / ((1 + s) * (1 + q * s)),
    "bipolar": lambda s, q: s / ((1 + s) * (1 + q * s)),
    "reversed": lambda s, q: 1 / ((1 - s) * (1 + q * s)),
}
#: What is looked for first, with the other time over tau, q: ``exp(-t)``, ``t exp(-t)``, its derivative
#: ``(1 - t) exp(-t)``, ``exp(t)`` that ends, and ``exp(-|t|)``; t is in units of tau since the begin.
TEMPLATES = (
    ("double_exponential", 0.0),
    ("double_exponential", 1.0),
    ("bipolar", 1.0),
    ("reversed", 0.0),
    ("double_exponential", -1.0),
)
MIN_RATIO = {"bipolar": 0.02}  # q; -1 where nothing is said
SPAN_TAU = 4.0  # tau after the begin until which a glitch is said to last
REACH_TAU = 25.0  # tau after the begin, from where on less than 1e-9 of its height is left
BLUR = 3.0  # periods of the highest frequency of the band, over which the low-pass spreads an instant
STEP = 1e-3  # of begin in tau, of the logarithm of tau, of the other time: for derivatives
PER_DECADE = 3  # of tau: the ratio falls by 2 % at most between two
SHORTEST = 30.0  # s, tau; what is shorter is masked
LONGEST = 10800.0  # s, tau
MAX_DURATION_FRACTION = 0.25  # of a run, that tau may take: what is longer passes for a drift
MAX_TRANSFORM = 2**19  # samples in transforms that are made at once: of all of them, the memory would be full
_PART = 4  # of columns, the same


@dataclass(frozen=True)
class Shape:
    """One of the `KINDS`, its tau [s], and its other time over that: before the begin if negative."""

    kind: str
    tau: float
    ratio: float = 0.0

    def transform(self, f: Array) -> Spectrum:
        """Return the transform of the shape that begins at zero, at the frequencies f [Hz], shape (B,)."""
        s = np.asarray(2j * np.pi * self.tau * f, dtype=np.complex128)
        return np.asarray(KINDS[self.kind](s, self.ratio), dtype=np.complex128)

    def lengthened(self, increment: float) -> "Shape":
        """Return the shape whose other time is longer by so much, in tau, as far as that goes."""
        return replace(
            self, ratio=float(np.clip(self.ratio + increment, MIN_RATIO.get(self.kind, -1.0), 1.0))
        )


@dataclass(frozen=True)
class Glitch:
    """A shape that begins `begin` [s] after the start of the run."""

    shape: Shape
    begin: float

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end [s] of where it is notable."""
        reach, q = SPAN_TAU * self.shape.tau, self.shape.ratio
        rise, decay = (1.0, q) if self.shape.kind == "reversed" else (-q, 1.0)
        return self.begin - reach * max(rise, 0.0), self.begin + reach * max(decay, 0.0)

    def shifted(self, steps: Array) -> "Glitch":
        """Return the glitch that begins later and takes longer, by (begin / tau, log tau, other / tau)."""
        late, longer, d_ratio = steps.tolist()
        shape = replace(self.shape.lengthened(d_ratio), tau=self.shape.tau * float(np.exp(longer)))
        return Glitch(shape, self.begin + late * self.shape.tau)

    def series(self, time: Array, fs: float) -> Array:
        """Return it at the evenly spaced instants `time` [s], shape (N,), no higher than about 1."""
        return np.asarray(series([self], time, fs)[0])


def series(glitches: Sequence[Glitch], time: Array, fs: float) -> Array:
    """Return glitches at the evenly spaced instants `time` [s], shape (number of glitches, N)."""
    sizes = [_padded(glitch, time.size, fs) for glitch in glitches]
    values, start = np.empty((len(glitches), time.size)), float(time[:1][0])
    for n in set(sizes):  # transforms of one length go faster together
        selected = [i for i, size in enumerate(sizes) if size == n]
        for some in (selected[part] for part in pieces(len(selected), length=max(1, MAX_TRANSFORM // n))):
            spectra = np.zeros((len(some), n // 2 + 1), dtype=np.complex128)
            for spectrum, i in zip(spectra, some, strict=True):
                _fill(spectrum, glitches[i], n, start, fs)
            of_some = scipy.fft.irfft(spectra, n)
            del spectra  # they are as large
            values[some] = of_some[:, : time.size]
    return values


def reach(glitch: Glitch, fs: float) -> tuple[float, float]:
    """Return begin and end [s] beyond which less than 1e-9 of the height of a glitch is left."""
    start, end = glitch.span
    margin = BLUR / min(derivatives.F_MAX, fs / 10)
    return (
        glitch.begin - (glitch.begin - start) * (REACH_TAU / SPAN_TAU) - margin,
        glitch.begin + (end - glitch.begin) * (REACH_TAU / SPAN_TAU) + margin,
    )


def _padded(glitch: Glitch, size: int, fs: float) -> int:
    """Return how many samples it takes to make so many of a glitch."""
    return int(scipy.fft.next_fast_len(size + int(2 * SPAN_TAU * glitch.shape.tau * fs), real=True))


def _fill(spectrum: Spectrum, glitch: Glitch, n: int, start: float, fs: float) -> None:
    """Fill in the transform of a glitch at n instants from `start` [s] on."""
    f, smooth = _low_pass(n, fs)
    filled = spectrum[: f.size]
    np.exp(2j * np.pi * (start - glitch.begin) * f, out=filled)
    filled *= glitch.shape.transform(f)
    filled *= smooth * (fs * glitch.shape.tau)


@lru_cache(maxsize=2)  # a shape that is moved and turned keeps its length for a while
def _low_pass(n: int, fs: float) -> tuple[Array, Array]:
    """Return the frequencies [Hz] of the transform of n samples up to where nothing is left, and what is."""
    f = scipy.fft.rfftfreq(n, 1 / fs)
    smooth = np.exp(-np.square(np.square(f / (2 * min(derivatives.F_MAX, fs / 10)))))
    n_nonzero = int(np.count_nonzero(smooth))
    f, smooth = f[:n_nonzero], smooth[:n_nonzero]
    for shared in (f, smooth):
        shared.setflags(write=False)  # others get the same ones
    return f, smooth


def bounds(duration: float) -> tuple[float, float]:
    """Return the least and the largest tau [s] to look for in a run that lasts so many seconds."""
    return SHORTEST, max(SHORTEST, min(LONGEST, MAX_DURATION_FRACTION * duration))


def bank(duration: float) -> list[Shape]:
    """Return the shapes to look for in a run that lasts so many seconds."""
    shortest, longest = bounds(duration)
    steps = int(PER_DECADE * np.log10(longest / shortest))
    taus = shortest * 10 ** (np.arange(steps + 1) / PER_DECADE)
    return [Shape(kind, float(tau), q) for tau in taus for kind, q in TEMPLATES]


def columns(glitches: Sequence[Glitch], time: Array, fs: float) -> Iterator[Array]:
    """Yield the glitches at the instants `time` [s], shape (N, G), some at a time."""
    for some in pieces(len(glitches), length=_PART):
        yield series(glitches[some], time, fs).T


def columns_with_derivatives(glitches: Sequence[Glitch], time: Array, fs: float) -> Iterator[Array]:
    """Yield the `columns`, then how each changes with begin, tau and other time, shape (N, 3).

    A strong glitch drives the loop, whose response determines stiffness and gain as that to an injection
    does, but only as well as the shape of the glitch is known: without these columns the answer would be
    trusted too much.
    """
    yield from columns(glitches, time, fs)
    for glitch in glitches:  # one by one: in long runs all of them fill the memory
        changes = steps(glitch)
        for some in pieces(changes.size, length=_PART):
            shifted = [glitch.shifted(step) for step in np.diag(changes)[some]]
            templates = series([glitch, *shifted], time, fs)
            yield ((templates[1:] - templates[0]) / changes[some, None]).T


def steps(glitch: Glitch) -> Array:
    """Return small changes of begin, tau and other time, shape (3,), see `Glitch.shifted`."""
    return np.array([STEP, STEP, -STEP if glitch.shape.ratio > 1 - STEP else STEP])
