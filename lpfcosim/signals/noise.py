"""Noise in streams, each seeded by its name so that the order of drawing never matters."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals import events
from lpfcosim.signals.drawing import PLAIN, Drawing
from lpfcosim.signals.injections import add_pulses
from lpfcosim.signals.streams import generator
from lpfcosim.spacecraft import Run

CORNER = 2e-6  # Hz, below which noise of 1/f is flat (choice)

Array = NDArray[np.float64]


Shares = tuple[tuple[str, float], ...]


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
    into: str | Shares
    level: float
    corner: float = 0.0

    @property
    def shares(self) -> Shares:
        """The signals it goes into, with their factors."""
        return ((self.into, 1.0),) if isinstance(self.into, str) else self.into

    def start(self, run: Run, drawing: Drawing = PLAIN) -> "Stream":
        """Return the stream at its beginning."""
        if self.corner:
            return _Red(run, self.name, self.level, self.corner, drawing)
        return _White(run, self.name, self.level, drawing)

    def psd(self, frequency: Array, h: float) -> Array:
        """Return the one-sided PSD of the stream, sampled every ``h`` seconds, at ``frequency`` [Hz]."""
        S = np.full(frequency.size, self.level**2)
        if self.corner:
            rho = np.exp(-2 * np.pi * self.corner * h)
            S *= np.abs(2 * np.pi * h / (1 - rho / np.exp(2j * np.pi * h * frequency))) ** 2
        return S


def tail(name: str, level: float, knee: float, into: Shares | None = None) -> tuple[Source, ...]:
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
    drawing : Drawing
        What it is drawn with.
    """

    def __init__(self, run: Run, sources: Sequence[Source], drawing: Drawing = PLAIN) -> None:
        self._run = run
        self._drawn = 0
        self._glitches = events.glitches(run)
        self._sources = [(source.shares, source.start(run, drawing)) for source in sources]

    def take(self, n: int) -> dict[str, Array]:
        """Draw the next ``n`` samples.

        Returns
        -------
        dict
            Every signal that a source goes into, SI, each of shape (n,).
        """
        drawn = {into: np.zeros(n) for shares, _ in self._sources for into, _ in shares}
        for shares, source in self._sources:
            stream = source.take(n)
            for into, factor in shares:
                drawn[into] += stream if factor == 1 else factor * stream
        events.let_drift(self._run, drawn, self._drawn)
        drawn["g_2"] += self._run.dc
        first, self._drawn = self._drawn, self._drawn + n
        add_pulses(self._run, drawn, first, first + n)
        events.add_glitches(self._run, self._glitches, drawn, first)
        return drawn


class _White:
    """White noise of one-sided ASD ``asd``."""

    def __init__(self, run: Run, name: str, asd: float, drawing: Drawing) -> None:
        self._fill = drawing.normals(generator(run, name))
        self._size = asd * math.sqrt(run.fs / 2)

    def take(self, n: int) -> Array:
        if self._size == 0:
            return np.zeros(n)
        drawn = np.empty(n)
        self._fill(drawn)
        drawn *= self._size
        return drawn


class _Red:
    """Stationary first-order autoregression of ASD ``slope``/f between ``corner`` [Hz] and Nyquist."""

    def __init__(self, run: Run, name: str, slope: float, corner: float, drawing: Drawing) -> None:
        # PSD 2 h step^2 / |1 - rho z^-1|^2 -> (slope / f)^2, with step = pi slope sqrt(2 h)
        self._source = _White(run, name, 2 * math.pi * slope * run.h, drawing)
        self._redden = drawing.redden
        self._rho = math.exp(-2 * math.pi * corner * run.h)
        self._last: float | None = None

    def take(self, n: int) -> Array:
        drawn = self._source.take(n)
        if self._last is None and n:
            drawn[0] /= math.sqrt(1 - self._rho**2)  # the first sample has the stationary variance
            self._last = 0.0
        if self._last is not None:
            self._last = self._redden(drawn, self._rho, self._last)
        return drawn
