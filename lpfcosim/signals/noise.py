"""Noise in streams, each seeded by its name so that the order of drawing never matters."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals import events
from lpfcosim.signals.injections import add_pulses
from lpfcosim.signals.seeding import generator
from lpfcosim.spacecraft import Run

CORNER = 2e-6  # Hz, below which noise of 1/f is flat (choice)

Array = NDArray[np.float64]


Weights = tuple[tuple[str, float], ...]


class Stream(Protocol):
    """A signal of a run, drawn block after block."""

    def take(self, n: int) -> Array:
        """Draw the next ``n`` samples."""


@dataclass(frozen=True)
class Source:
    """A stream of noise: white of ASD ``level``, or with a ``corner`` [Hz] of ASD ``level``/f above it.

    It goes ``into`` one signal, or into several, each with a factor of its own.
    """

    name: str
    into: str | Weights
    level: float
    corner: float = 0.0

    @property
    def shares(self) -> Weights:
        """The signals it goes into, with their factors."""
        return ((self.into, 1.0),) if isinstance(self.into, str) else self.into

    def start(self, run: Run) -> "Stream":
        """Return the stream at its beginning."""
        nyquist = run.fs / 2
        if not self.corner:
            return _AutoregressiveStream(run, self.name, self.level * math.sqrt(nyquist), 0.0)
        # PSD 2 h size^2 / |1 - rho z^-1|^2 -> (level / f)^2, with size = pi level sqrt(2 h)
        size = 2 * math.pi * self.level * run.h * math.sqrt(nyquist)
        return _AutoregressiveStream(run, self.name, size, math.exp(-2 * math.pi * self.corner * run.h))

    def psd(self, frequency: Array, h: float) -> Array:
        """Return the one-sided PSD of the stream, sampled every ``h`` seconds, at ``frequency`` [Hz]."""
        S = np.full(frequency.size, self.level**2)
        if self.corner:
            rho = np.exp(-2 * np.pi * self.corner * h)
            S *= np.abs(2 * np.pi * h / (1 - rho / np.exp(2j * np.pi * h * frequency))) ** 2
        return S


def red_noise(name: str, level: float, knee: float, into: Weights | None = None) -> tuple[Source, ...]:
    """1/f noise that meets a white level at the knee [Hz]; none without one."""
    return (Source(f"{name}_tail", into or name, level * knee, CORNER),) if knee else ()


class Noise:
    """Noise of a run, drawn in blocks of any size to the same bits; a level of zero gives exact zeros.

    The signal g_2 also carries the constant ``run.dc``, and g_1 and g_2 the injected pulses and glitches.

    Parameters
    ----------
    run : Run
        Its name and seed.
    sources : sequence of Source
        What drives it.
    """

    def __init__(self, run: Run, sources: Sequence[Source]) -> None:
        self._run = run
        self._drawn = 0
        self._glitches = events.glitches(run)
        self._sources = [(source.shares, source.start(run)) for source in sources]

    def take(self, n: int) -> dict[str, Array]:
        """Draw the next ``n`` samples.

        Returns
        -------
        dict
            Every signal that a source goes into, SI, each of shape (n,).
        """
        drawn: dict[str, Array] = {}
        for shares, source in self._sources:
            stream = source.take(n)
            for into, factor in shares:
                part = stream if len(shares) == factor == 1 else factor * stream
                if into in drawn:
                    drawn[into] += part
                else:
                    drawn[into] = part
        events.apply_level_drift(self._run, drawn, self._drawn)
        if self._run.dc:
            drawn["g_2"] += self._run.dc
        first_sample, self._drawn = self._drawn, self._drawn + n
        add_pulses(self._run, drawn, first_sample, first_sample + n)
        events.add_glitches(self._run, self._glitches, drawn, first_sample)
        return drawn


class _AutoregressiveStream:
    """Stationary first-order autoregression, ``y[i] = size x[i] + rho y[i-1]``; white noise without `rho`."""

    def __init__(self, run: Run, name: str, size: float, rho: float) -> None:
        self._generator, self._size, self._rho = generator(run, name), size, rho
        self._state: Array | None = None

    def take(self, n: int) -> Array:
        if self._size == 0:
            return np.zeros(n)
        x = self._size * self._generator.standard_normal(n)
        if not self._rho or not n:
            return x
        from scipy.signal import lfilter  # takes its time, and what only names the models has no need of it

        if self._state is None:
            self._state = np.zeros(1)
            x[0] /= math.sqrt(1 - self._rho**2)  # the first sample has the stationary variance
        y, self._state = lfilter([1.0], [1.0, -self._rho], x, zi=self._state)
        return np.asarray(y)
