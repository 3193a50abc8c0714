"""Noise in streams, each seeded by its name so that the order of drawing never matters."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.signals import events
from lpfcosim.signals.seeding import generator
from lpfcosim.spacecraft import Run

CORNER = 2e-6  # Hz, below which noise of 1/f is flat (choice)
FLICKER_KNEE = 1e-3  # Hz, below which noise of the electrodes rises as f^-1/2 (choice)
# Zeros and poles of f^-1/2, relative to its knee, and its white level. By least largest deviation, the ASD
# is within 6.3 % of max(1, (knee/f)^1/2) from a hundredth of the knee up; it is flat below.
_FLICKER_ZEROS, _FLICKER_POLES, _FLICKER_LEVEL = (0.04434, 0.4048, 0.4048), (0.01138, 0.2138, 0.2138), 0.9542

Array = NDArray[np.float64]
Weights = tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Source:
    """A stream of noise: white, through a filter.

    Attributes
    ----------
    name : str
        Its seed.
    into : str or tuple of (str, float)
        The signal it goes into, or several, each with a factor of its own.
    level : float
        ASD at the Nyquist frequency, in the unit of the signal per root Hz.
    zeros, poles : tuple of float
        Of the filter [Hz]. From high frequencies to low, the ASD begins to rise as 1/f at each zero, and
        stops at each pole.
    """

    name: str
    into: str | Weights
    level: float
    zeros: tuple[float, ...] = ()
    poles: tuple[float, ...] = ()

    @property
    def shares(self) -> Weights:
        """The signals it goes into, with their factors."""
        return ((self.into, 1.0),) if isinstance(self.into, str) else self.into

    def sections(self, h: float) -> Array:
        """Return the filter of unit white noise, sampled every ``h`` seconds, in sections of first order.

        They are those of `scipy.signal.sosfilt`, shape (n, 6), each with a pole and a zero or none.
        """
        sections = np.zeros((max(1, len(self.poles)), 6))
        sections[:, [0, 3]] = 1.0
        sections[: len(self.zeros), 1] = -np.exp(-2 * np.pi * h * np.array(self.zeros))
        sections[: len(self.poles), 4] = -np.exp(-2 * np.pi * h * np.array(self.poles))
        at_nyquist = (1 - sections[:, 1]) / (1 - sections[:, 4])
        sections[:, :2] /= at_nyquist[:, np.newaxis]
        sections[0, :2] *= self.level * math.sqrt(0.5 / h)
        return sections

    def psd(self, frequency: Array, h: float) -> Array:
        """Return the one-sided PSD of the stream, sampled every ``h`` seconds, at ``frequency`` [Hz]."""
        delay = np.exp(-2j * np.pi * h * frequency)
        responses = [(b_0 + b_1 * delay) / (1 + a_1 * delay) for b_0, b_1, _, _, a_1, _ in self.sections(h)]
        return np.asarray(2 * h * np.abs(np.prod(responses, axis=0)) ** 2)


def white(name: str, level: float, knee: float = 0.0, into: Weights | None = None) -> Source:
    """Return noise of ASD ``level`` that rises as 1/f below a knee [Hz], down to `CORNER`."""
    return (
        Source(name, into or name, level, (knee,), (CORNER,)) if knee else Source(name, into or name, level)
    )


def red(name: str, level: float, h: float, corner: float = CORNER) -> Source:
    """Return noise of ASD ``level``/f above a corner [Hz]; ``level`` in units of the signal times Hz^0.5."""
    return Source(name, name, math.pi * h * level, poles=(corner,))


def flicker(name: str, level: float) -> Source:
    """Return noise of ASD ``level`` that rises as f^-1/2 below `FLICKER_KNEE`."""
    zeros, poles = (tuple(FLICKER_KNEE * f for f in ratios) for ratios in (_FLICKER_ZEROS, _FLICKER_POLES))
    return Source(name, name, _FLICKER_LEVEL * level, zeros, poles)


class Noise:
    """Noise of a run, drawn in blocks of any size to the same bits; a level of zero gives exact zeros.

    The signal g_2 also carries the constant ``run.dc``, and g_1 and g_2 the glitches.

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
        self._sources = [(source.shares, _Stream(source, run)) for source in sources]

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
        if self._run.dc:
            drawn["g_2"] += self._run.dc
        first_sample, self._drawn = self._drawn, self._drawn + n
        events.add_glitches(self._run, self._glitches, drawn, first_sample)
        return drawn


class _Stream:
    """A source, drawn block after block; stationary from the first sample on."""

    def __init__(self, source: Source, run: Run) -> None:
        self._generator, self._level = generator(run.seed, run.name, source.name), source.level
        self._sections = source.sections(run.h)
        self._delays = np.zeros((len(self._sections), 2))  # of the sections
        if source.level and source.poles:
            self._delays[:, 0] = self._stationary_delays()

    def _stationary_delays(self) -> Array:
        """Draw the delays of the sections, whose covariance P solves P = A P A' + B B'."""
        from scipy.linalg import solve_discrete_lyapunov

        n = len(self._sections)
        A, B = np.zeros((n, n)), np.zeros(n)
        states, white = np.zeros(n), 1.0  # what the input of a section is of delays and white noise
        for i, (b_0, b_1, _, _, a_1, _) in enumerate(self._sections):
            A[i], B[i] = (b_1 - a_1 * b_0) * states, (b_1 - a_1 * b_0) * white
            A[i, i] -= a_1
            states, white = b_0 * states, b_0 * white
            states[i] += 1
        variances, axes = np.linalg.eigh(solve_discrete_lyapunov(A, np.outer(B, B)))
        return np.asarray(axes @ (np.sqrt(np.maximum(variances, 0)) * self._generator.standard_normal(n)))

    def take(self, n: int) -> Array:
        """Draw the next ``n`` samples."""
        if not self._level:
            return np.zeros(n)
        x = self._generator.standard_normal(n)
        if not self._sections[:, 4].any():
            return np.asarray(self._sections[0, 0] * x)
        from scipy.signal import sosfilt  # takes its time, and what only names the models has no need of it

        y, self._delays = sosfilt(self._sections, x, zi=self._delays)
        return np.asarray(y)
