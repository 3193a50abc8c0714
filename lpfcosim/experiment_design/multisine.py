"""From powers to tones: few harmonics with amplitudes and phases that reach the limits on peaks as well.

All tones of an experiment begin and end together and are harmonics of that time, so that they are orthogonal
and have whole cycles. Amplitudes and phases are complex numbers. They are scaled so that the tightest limit
is just met; what is left is a problem without constraints, which L-BFGS solves. A peak is a p-norm, which
rises until it is the peak itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from lpfcosim.experiment_design.design_problem import DesignProblem
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]

NORMS = (16.0, 64.0)  # that stand for a peak, in turn
ITERATIONS = 100  # for each
MAX_NORM = 400.0  # norm that stands for the tightest of all limits
PER_CYCLE = 8  # samples at least of the fastest tone


@dataclass(frozen=True)
class ToneWindow:
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
        flank = np.clip(np.minimum(t - self.start, self.end - t) / self.ramp, 0, 1)
        return np.asarray((0.5 - 0.5 * np.cos(np.pi * flank)) ** 2)


@dataclass(frozen=True)
class Multisine:
    """The tones of one experiment.

    Attributes
    ----------
    experiment : DesignedExperiment
        The experiment.
    window : ToneWindow
        When they are on.
    number : ndarray of int, shape (K,)
        Of the frequency of each tone among the harmonics of the window.
    loop : ndarray of int, shape (K,)
        Which of the loops of the experiment it goes into.
    amplitudes : ndarray of complex, shape (K,)
        In units of `units`: the injected signal is ``Re(u units exp(i w (t - start)))``.
    margins : ndarray, shape (limits,)
        What each limit is tightened to: transients go beyond what steady tones do.
    """

    experiment: DesignedExperiment
    window: ToneWindow
    number: Indices
    loop: Indices
    amplitudes: Complex
    margins: Array = field(repr=False)

    @property
    def frequency(self) -> Array:
        """Of the tones [Hz], shape (K,)."""
        return np.asarray(self.number / self.window.length)

    def __len__(self) -> int:
        return self.number.size

    @cached_property
    def _responses(self) -> tuple[Complex, Complex]:
        """Sensitivities (K, P) and costs (K, limits) of tones of amplitude one."""
        frequency, row = np.unique(self.frequency, return_inverse=True)
        sensitivity, cost = self.experiment.responses(frequency)
        return sensitivity[row, :, self.loop], cost[row, :, self.loop]

    @cached_property
    def units(self) -> Array:
        """Amplitude of a tone that costs about one, shape (K,)."""
        return np.asarray(1 / np.sqrt(np.sum(np.abs(self._responses[1]) ** 2, axis=1)))

    @cached_property
    def _power(self) -> Array:
        return self.window.power(self.experiment.run.n_samples / self.experiment.run.fs, 4000)

    @cached_property
    def _sensitivity(self) -> Complex:
        seconds = self.experiment.model.equivalent_duration(self._power)
        return np.asarray(self._responses[0] * self.units[:, None] * np.sqrt(seconds))

    @cached_property
    def _cost(self) -> Complex:
        return np.asarray(self._responses[1] * self.units[:, None] / self.margins)

    @cached_property
    def _of_rms(self) -> NDArray[np.bool_]:
        return np.array([limit.kind == "rms" for limit in self.experiment.active_limits])

    @cached_property
    def _sums(self) -> Array:
        """What adds up tones of the same frequency, shape (n, K)."""
        return np.asarray(np.unique(self.number)[:, None] == self.number, dtype=float)

    @cached_property
    def _lines(self) -> tuple[Indices, int]:
        """Harmonics (n,) of the period of all tones together, and the number of samples of it."""
        lines = np.unique(self.number) // int(np.gcd.reduce(self.number))
        return lines, scipy.fft.next_fast_len(int(PER_CYCLE * lines.max()), real=True)

    def information(self, u: Complex) -> tuple[Array, Complex]:
        """Return the information of amplitudes, shape (P, P), and its factor by frequency, shape (n, P)."""
        y = self._sums @ (self._sensitivity * u[:, None])
        return (y.conj().T @ y).real, y

    def slope(self, dual: Array, y: Complex) -> Complex:
        """Return the derivative of ``tr(Z I)`` by the amplitudes, shape (K,)."""
        return np.asarray(2 * np.sum(self._sensitivity.conj() * (self._sums.T @ (y @ dual)), axis=1))

    def limited(self, u: Complex) -> tuple[Complex, Array, Array]:
        """Return the limited quantities in units of their limits.

        Returns
        -------
        spectra : ndarray of complex, shape (limits, n)
            Amplitudes by frequency.
        rms : ndarray, shape (limits,)
            Over the run.
        waves : ndarray, shape (limits, M)
            The steady signals over a period of all tones.
        """
        Y = (self._sums @ (self._cost * u[:, None])).T
        lines, size = self._lines
        spectrum = np.zeros((len(Y), size // 2 + 1), dtype=np.complex128)
        spectrum[:, lines] = Y
        rms = np.sqrt(np.sum(np.abs(Y) ** 2, axis=1) / 2 * np.mean(self._power))
        return Y, rms, scipy.fft.irfft(spectrum, size) * size / 2

    def reach(self, u: Complex) -> float:
        """Return how far the tightest limit is reached."""
        _, rms, waves = self.limited(u)
        return float(np.max(np.where(self._of_rms, rms, np.abs(waves).max(axis=1))))

    def smooth_reach(self, u: Complex, norm: float) -> tuple[float, Complex]:
        """Return a smooth measure of the same, peaks as p-norms, and its derivative, shape (K,)."""
        Y, rms, waves = self.limited(u)
        lines, size = self._lines
        top = np.maximum(np.abs(waves).max(axis=1, keepdims=True), np.finfo(float).tiny)
        ratio = np.abs(waves) / top
        mean = np.maximum(np.mean(ratio**norm, axis=1, keepdims=True), np.finfo(float).tiny)
        peaks = (top * mean ** (1 / norm))[:, 0]
        weights = np.sign(waves) * ratio ** (norm - 1) * mean ** (1 / norm - 1) / size
        of_peaks = scipy.fft.rfft(weights)[:, lines]
        of_rms = Y * np.mean(self._power) / 2 / np.maximum(rms, np.finfo(float).tiny)[:, None]
        values = np.where(self._of_rms, rms, peaks)
        slopes = np.where(self._of_rms[:, None], of_rms, of_peaks)
        q = min(4 * norm, MAX_NORM)
        largest = values.max()
        total = float(np.sum((values / largest) ** q))
        shares = (values / largest) ** (q - 1) * total ** (1 / q - 1)
        slope = np.sum(self._cost.conj() * (self._sums.T @ (slopes.T * shares)), axis=1)
        return float(largest * total ** (1 / q)), slope

    def strongest(self, count: int) -> "Multisine":
        """Return at most so many tones in each loop, those kept that cost most."""
        size = np.abs(self.amplitudes)
        kept = [
            k
            for loop in np.unique(self.loop)
            for k in sorted(np.flatnonzero(self.loop == loop), key=lambda k: -size[k])[:count]
        ]
        kept.sort()
        return replace(self, number=self.number[kept], loop=self.loop[kept], amplitudes=self.amplitudes[kept])


@dataclass(frozen=True)
class Solution:
    """Several experiments together.

    Attributes
    ----------
    multisines : tuple of Multisine
        Their tones.
    information : ndarray, shape (P, P)
        Of all of them.
    value : float
        The objective.
    """

    multisines: tuple[Multisine, ...]
    information: Array
    value: float


def evaluate(problem: DesignProblem, multisines: Sequence[Multisine]) -> Solution:
    """Return the solution that given tones are."""
    information = problem.base_information + sum(m.information(m.amplitudes)[0] for m in multisines)
    return Solution(tuple(multisines), information, problem.objective.value(information))


def improve(
    problem: DesignProblem, multisines: Sequence[Multisine], norms: Sequence[float] = NORMS
) -> Solution:
    """Return the tones with amplitudes and phases improved by L-BFGS, the tightest limit of each just met."""
    ends = np.cumsum([len(m) for m in multisines])[:-1]
    objective, base_information = problem.objective, problem.base_information

    def value(x: Array, norm: float) -> tuple[float, Array]:
        information, contributions = base_information.copy(), []
        for multisine, u in zip(multisines, np.split(x.view(np.complex128), ends), strict=True):
            reach, of_reach = multisine.smooth_reach(u, norm)
            tones, y = multisine.information(u / reach)
            information += tones
            contributions.append((multisine, reach, of_reach, tones, y))
        Z = objective.dual(information)
        slopes = [
            (float(np.sum(Z * tones)) * of_reach - 0.5 * multisine.slope(Z, y)) / reach
            for multisine, reach, of_reach, tones, y in contributions
        ]
        return float(np.log(objective.value(information))), np.concatenate(slopes).view(np.float64)

    x = np.concatenate([m.amplitudes for m in multisines]).view(np.float64)
    options = {"maxiter": ITERATIONS, "maxcor": 20}
    for norm in norms:
        smooth_value = partial(value, norm=norm)
        result: Any = scipy.optimize.minimize(smooth_value, x, method="L-BFGS-B", jac=True, options=options)  # type: ignore[call-overload]
        x = result.x
    improved = [
        replace(m, amplitudes=u / m.reach(u))
        for m, u in zip(multisines, np.split(x.view(np.complex128), ends), strict=True)
    ]
    return evaluate(problem, improved)
