"""From powers to tones: few harmonics with amplitudes and phases that reach the limits on peaks as well.

All tones of an experiment begin and end together and are harmonics of that time, so that they are orthogonal
and have whole cycles. Amplitudes and phases are complex numbers, one for each tone and loop. They are scaled
so that the tightest limit is just met; what is left is a problem without constraints, which L-BFGS solves. A
peak is a p-norm, which rises until it is the peak itself. Then the least of the tones are dropped, until few
are left.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.experiment_design.objective import Objective
from lpfcosim.experiment_design.stage import Stage

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]

NORMS = (4, 8, 16, 32, 64)  # that stand for a peak, of many tones
FEWER = (16, 32, 64)  # of tones that are becoming few
LAST = (32, 64, 128, 256, 512)  # and at the end
STEPS = (24, 16, 12, 8)  # of fewer and fewer tones in a loop
FIRST, BETWEEN, AT_LAST = 100, 60, 120  # iterations for each
AGAIN, MORE, SHORT = (32, 64), 2, 40  # norms, tones and iterations where tones grow anew
SMOOTH = 400.0  # norm that stands for the tightest of all limits
PER_CYCLE = 8  # samples at least of the fastest tone


@dataclass(frozen=True)
class Span:
    """When the tones of an experiment are on.

    Attributes
    ----------
    start, end : float
        Seconds from the start of the run.
    ramp : float
        In which they rise, and fall [s].
    """

    start: float
    end: float
    ramp: float

    @property
    def length(self) -> float:
        """Of the span [s]."""
        return self.end - self.start

    def power(self, duration: float, count: int) -> Array:
        """Return the power of a tone at even times over a run, relative to its largest, shape (count,)."""
        t = np.linspace(0, duration, count)
        left = np.clip(np.minimum(t - self.start, self.end - t) / self.ramp, 0, 1)
        return np.asarray((0.5 - 0.5 * np.cos(np.pi * left)) ** 2)


@dataclass(frozen=True)
class Voice:
    """The tones of one experiment.

    Attributes
    ----------
    stage : Stage
        The experiment.
    span : Span
        When they are on.
    number : ndarray of int, shape (n,)
        Of each frequency among the harmonics of the span.
    used : ndarray of bool, shape (n, L)
        Which loops a frequency goes into.
    amplitudes : ndarray of complex, shape (n, L)
        In each loop: the injected signal is ``Re(u exp(i w (t - start)))``.
    margins : ndarray, shape (limits,)
        What each limit is tightened to: transients go beyond what steady tones do.
    """

    stage: Stage
    span: Span
    number: NDArray[np.intp]
    used: Flags
    amplitudes: Complex
    margins: Array = field(repr=False)

    @property
    def frequency(self) -> Array:
        """Of the tones [Hz], shape (n,)."""
        return np.asarray(self.number / self.span.length)


class Chord:
    """What the tones of one experiment tell and cost, as functions of scaled amplitudes."""

    def __init__(self, voice: Voice) -> None:
        self.voice = voice
        stage, span = voice.stage, voice.span
        told, cost = stage.responses(voice.frequency)
        power = span.power(stage.run.n_samples / stage.run.fs, 4000)
        self._energy = float(np.mean(power))
        units = 1 / np.sqrt(np.maximum(np.sum(np.abs(cost) ** 2, axis=1), 1e-300))
        self.units = units  # amplitude that costs about one, shape (n, L)
        self._told = told * units[:, None, :] * np.sqrt(stage.sight.equivalent_duration(power))
        self._cost = cost * units[:, None, :] / voice.margins[:, None]
        period = int(np.gcd.reduce(voice.number))  # all tones together repeat so often in the span
        self._line = voice.number // period
        self._size = scipy.fft.next_fast_len(int(PER_CYCLE * self._line.max()), real=True)

    def information(self, u: Complex) -> tuple[Array, Complex]:
        """Return what scaled amplitudes tell, shape (P, P), and the same tone by tone, shape (n, P)."""
        y = np.einsum("npl,nl->np", self._told, u)
        return (y.conj().T @ y).real, y

    def slope(self, dual: Array, y: Complex) -> Complex:
        """Return the derivative of ``tr(Z I)`` by the amplitudes, shape (n, L)."""
        return np.asarray(2 * np.einsum("npl,np->nl", self._told.conj(), y @ dual))

    def reach(self, u: Complex) -> float:
        """Return how far the tightest limit is reached."""
        Y = np.einsum("nkl,nl->kn", self._cost, u)
        rms = np.sqrt(np.sum(np.abs(Y) ** 2, axis=1) / 2 * self._energy)
        peaks = np.max(np.abs(self._waves(Y)), axis=1)
        of_rms = np.array([limit.kind == "rms" for limit in self.voice.stage.bounds])
        return float(np.max(np.where(of_rms, rms, peaks)))

    def _waves(self, Y: Complex) -> Array:
        """Return the steady signals over one period, shape (..., M), of amplitudes, shape (..., n)."""
        spectrum = np.zeros((*Y.shape[:-1], self._size // 2 + 1), dtype=np.complex128)
        spectrum[..., self._line] = Y
        return np.asarray(scipy.fft.irfft(spectrum, self._size) * self._size / 2)

    def spent(self, u: Complex, norm: float) -> tuple[float, Complex]:
        """Return a smooth measure of the same, peaks as p-norms, and its derivative."""
        values, slopes = [], []
        for k, limit in enumerate(self.voice.stage.bounds):
            cost = self._cost[:, k]
            Y = np.sum(cost * u, axis=1)
            value, of_Y = self._rms(Y) if limit.kind == "rms" else self._peak(Y, norm)
            values.append(value)
            slopes.append(cost.conj() * of_Y[:, None])
        reach = np.array(values)
        top = float(reach.max())
        q = min(4 * norm, SMOOTH)
        total = float(np.sum((reach / top) ** q))
        shares = (reach / top) ** (q - 1) * total ** (1 / q - 1)
        found = np.einsum("k,knl->nl", shares, np.array(slopes))
        return top * total ** (1 / q), np.asarray(found)

    def _rms(self, Y: Complex) -> tuple[float, Complex]:
        value = float(np.sqrt(np.sum(np.abs(Y) ** 2) / 2 * self._energy))
        return value, np.asarray(Y * self._energy / 2 / max(value, 1e-300))

    def _peak(self, Y: Complex, norm: float) -> tuple[float, Complex]:
        y = self._waves(Y)
        top = float(np.max(np.abs(y)))
        if top == 0:  # what none of the loops moves
            return 0.0, np.zeros_like(Y)
        ratio = np.abs(y) / top
        mean = float(np.mean(ratio**norm))
        weights = np.sign(y) * ratio ** (norm - 1) * mean ** (1 / norm - 1) / self._size
        return top * mean ** (1 / norm), np.asarray(scipy.fft.rfft(weights)[self._line])


@dataclass(frozen=True)
class Score:
    """Several experiments together.

    Attributes
    ----------
    voices : tuple of Voice
        Scaled so that the tightest limit of each is just met.
    information : ndarray, shape (P, P)
        What they tell.
    value : float
        The objective.
    """

    voices: tuple[Voice, ...]
    information: Array
    value: float


class Ensemble:
    """Several experiments whose amplitudes are sought together."""

    def __init__(self, voices: Sequence[Voice], known: Array, objective: Objective) -> None:
        self._chords = [Chord(voice) for voice in voices]
        self._known, self._objective = known, objective

    def improve(self, norms: Sequence[float], iterations: int) -> Score:
        """Seek better amplitudes, the norm that stands for a peak rising."""
        x = np.concatenate([self._packed(c, c.voice.amplitudes / c.units) for c in self._chords])
        for norm in norms:
            options = {"maxiter": iterations, "maxcor": 20}
            value = partial(self._value, norm=norm)
            found: Any = scipy.optimize.minimize(value, x, method="L-BFGS-B", jac=True, options=options)  # type: ignore[call-overload]
            x = found.x
        return self._score(x)

    def _score(self, x: Array) -> Score:
        information, voices = self._known.copy(), []
        for chord, u in zip(self._chords, self._unpacked(x), strict=True):
            u = u / chord.reach(u)
            information += chord.information(u)[0]
            voices.append(replace(chord.voice, amplitudes=u * chord.units))
        logs = self._objective.logs(information)
        return Score(tuple(voices), information, self._objective.value(logs))

    def _value(self, x: Array, norm: float) -> tuple[float, Array]:
        information, parts = self._known.copy(), []
        for chord, u in zip(self._chords, self._unpacked(x), strict=True):
            spent, of_spent = chord.spent(u, norm)
            u = u / spent
            own, y = chord.information(u)
            information += own
            parts.append((chord, spent, of_spent, own, y))
        value, weights = self._objective.slope(self._objective.logs(information))
        Z = self._objective.dual(information, weights)
        slopes = []
        for chord, spent, of_spent, own, y in parts:
            of_u = chord.slope(Z, y) / spent - 2 * float(np.sum(Z * own)) / spent * of_spent
            slopes.append(self._packed(chord, -0.5 * of_u))
        return value, np.concatenate(slopes)

    @staticmethod
    def _packed(chord: Chord, u: Complex) -> Array:
        kept = u[chord.voice.used]
        return np.concatenate([kept.real, kept.imag])

    def _unpacked(self, x: Array) -> list[Complex]:
        found, at = [], 0
        for chord in self._chords:
            used = chord.voice.used
            n = int(used.sum())
            u = np.zeros(used.shape, dtype=np.complex128)
            u[used] = x[at : at + n] + 1j * x[at + n : at + 2 * n]
            found.append(u)
            at += 2 * n
        return found


def scored(voices: Sequence[Voice], known: Array, objective: Objective) -> Score:
    """Return what experiments with these very tones tell."""
    information = known.copy()
    for voice in voices:
        chord = Chord(voice)
        information += chord.information(voice.amplitudes / chord.units)[0]
    return Score(tuple(voices), information, objective.value(objective.logs(information)))


def pruned(voices: Sequence[Voice], most: int) -> tuple[Voice, ...]:
    """Return the experiments with at most so many tones in each loop, those kept that cost most."""
    found = []
    for voice in voices:
        size = np.abs(voice.amplitudes) / Chord(voice).units
        order = np.argsort(np.argsort(-size, axis=0), axis=0)
        used = voice.used & (order < most)
        kept = used.any(axis=1)
        found.append(
            replace(
                voice,
                number=voice.number[kept],
                used=used[kept],
                amplitudes=np.where(used, voice.amplitudes, 0)[kept],
            )
        )
    return tuple(found)


def steps(most: int) -> int:
    """Return how many steps `composed` takes to so many tones."""
    return 3 + sum(size > most for size in STEPS)


def composed(
    voices: Sequence[Voice],
    known: Array,
    objective: Objective,
    most: int,
    told: Callable[[float], None],
) -> Score:
    """Return few tones: seek amplitudes, drop the least, and again."""
    score = Ensemble(voices, known, objective).improve(NORMS, FIRST)
    told(score.value)
    return _thinned(score, known, objective, (*(n for n in STEPS if n > most), most), told)


def regrown(
    voices: Sequence[Voice],
    known: Array,
    objective: Objective,
    most: int,
    told: Callable[[float], None],
) -> Score:
    """Return few tones where many faint ones joined those there were: better ones take their places."""
    score = Ensemble(voices, known, objective).improve(AGAIN, SHORT)
    return _thinned(score, known, objective, (most + MORE, most), told)


def _thinned(
    score: Score, known: Array, objective: Objective, sizes: Sequence[int], told: Callable[[float], None]
) -> Score:
    """Drop the least tones, down to one size after another, then finish those that are left."""
    for size in sizes:
        score = Ensemble(pruned(score.voices, size), known, objective).improve(FEWER, BETWEEN)
        told(score.value)
    return finished(score.voices, known, objective, told)


def finished(
    voices: Sequence[Voice],
    known: Array,
    objective: Objective,
    told: Callable[[float], None],
) -> Score:
    """Return the tones with the best amplitudes and phases, peaks as they are."""
    score = Ensemble(voices, known, objective).improve((16.0, *LAST), AT_LAST)
    told(score.value)
    return score
