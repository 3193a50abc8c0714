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

from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.objective import Objective

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]

NORMS = (4, 8, 16, 32, 64)  # that stand for a peak, of many tones
PRUNING_NORMS = (16, 32, 64)  # of tones that are becoming few
FINAL_NORMS = (32, 64, 128, 256, 512)  # and at the end
STEPS = (24, 16, 12, 8)  # of fewer and fewer tones in a loop
COMPOSE_ITERATIONS, PRUNE_ITERATIONS, POLISH_ITERATIONS = 100, 60, 120  # iterations for each
EXCHANGE_NORMS, EXCHANGED_TONES, EXCHANGE_ITERATIONS = (
    (32, 64),
    2,
    40,
)  # norms, tones and iterations where tones grow anew
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
    number : ndarray of int, shape (n,)
        Of each frequency among the harmonics of the span.
    used : ndarray of bool, shape (n, L)
        Which loops a frequency goes into.
    amplitudes : ndarray of complex, shape (n, L)
        In each loop: the injected signal is ``Re(u exp(i w (t - start)))``.
    margins : ndarray, shape (limits,)
        What each limit is tightened to: transients go beyond what steady tones do.
    """

    experiment: DesignedExperiment
    window: ToneWindow
    number: NDArray[np.intp]
    used: Flags
    amplitudes: Complex
    margins: Array = field(repr=False)

    @property
    def frequency(self) -> Array:
        """Of the tones [Hz], shape (n,)."""
        return np.asarray(self.number / self.window.length)


class MultisineModel:
    """Information and cost of the tones of one experiment, as functions of scaled amplitudes."""

    def __init__(self, multisine: Multisine) -> None:
        self.multisine = multisine
        experiment, window = multisine.experiment, multisine.window
        sensitivity, cost = experiment.responses(multisine.frequency)
        power = window.power(experiment.run.n_samples / experiment.run.fs, 4000)
        self._energy = float(np.mean(power))
        units = 1 / np.sqrt(np.maximum(np.sum(np.abs(cost) ** 2, axis=1), 1e-300))
        self.units = units  # amplitude that costs about one, shape (n, L)
        self._sensitivity = (
            sensitivity * units[:, None, :] * np.sqrt(experiment.model.equivalent_duration(power))
        )
        self._cost = cost * units[:, None, :] / multisine.margins[:, None]
        period = int(np.gcd.reduce(multisine.number))  # all tones together repeat so often in the span
        self._line = multisine.number // period
        self._size = scipy.fft.next_fast_len(int(PER_CYCLE * self._line.max()), real=True)

    def information(self, u: Complex) -> tuple[Array, Complex]:
        """Return the information of scaled amplitudes, shape (P, P), and its factor by tone, shape (n, P)."""
        y = np.einsum("npl,nl->np", self._sensitivity, u)
        return (y.conj().T @ y).real, y

    def slope(self, dual: Array, y: Complex) -> Complex:
        """Return the derivative of ``tr(Z I)`` by the amplitudes, shape (n, L)."""
        return np.asarray(2 * np.einsum("npl,np->nl", self._sensitivity.conj(), y @ dual))

    def reach(self, u: Complex) -> float:
        """Return how far the tightest limit is reached."""
        Y = np.einsum("nkl,nl->kn", self._cost, u)
        rms = np.sqrt(np.sum(np.abs(Y) ** 2, axis=1) / 2 * self._energy)
        peaks = np.max(np.abs(self._waves(Y)), axis=1)
        of_rms = np.array([limit.kind == "rms" for limit in self.multisine.experiment.active_limits])
        return float(np.max(np.where(of_rms, rms, peaks)))

    def _waves(self, Y: Complex) -> Array:
        """Return the steady signals over one period, shape (..., M), of amplitudes, shape (..., n)."""
        spectrum = np.zeros((*Y.shape[:-1], self._size // 2 + 1), dtype=np.complex128)
        spectrum[..., self._line] = Y
        return np.asarray(scipy.fft.irfft(spectrum, self._size) * self._size / 2)

    def smooth_reach(self, u: Complex, norm: float) -> tuple[float, Complex]:
        """Return a smooth measure of the same, peaks as p-norms, and its derivative."""
        values, slopes = [], []
        for k, limit in enumerate(self.multisine.experiment.active_limits):
            cost = self._cost[:, k]
            Y = np.sum(cost * u, axis=1)
            value, of_Y = self._rms(Y) if limit.kind == "rms" else self._peak(Y, norm)
            values.append(value)
            slopes.append(cost.conj() * of_Y[:, None])
        reach = np.array(values)
        top = float(reach.max())
        q = min(4 * norm, MAX_NORM)
        total = float(np.sum((reach / top) ** q))
        shares = (reach / top) ** (q - 1) * total ** (1 / q - 1)
        slope = np.einsum("k,knl->nl", shares, np.array(slopes))
        return top * total ** (1 / q), np.asarray(slope)

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
class Solution:
    """Several experiments together.

    Attributes
    ----------
    multisines : tuple of Multisine
        Scaled so that the tightest limit of each is just met.
    information : ndarray, shape (P, P)
        Their information.
    value : float
        The objective.
    """

    multisines: tuple[Multisine, ...]
    information: Array
    value: float


class MultisineProblem:
    """The optimisation of the amplitudes of several experiments together."""

    def __init__(
        self, multisines: Sequence[Multisine], base_information: Array, objective: Objective
    ) -> None:
        self._models = [MultisineModel(multisine) for multisine in multisines]
        self._base_information, self._objective = base_information, objective

    def improve(self, norms: Sequence[float], iterations: int) -> Solution:
        """Improve the amplitudes by L-BFGS, with rising norms in the place of peaks."""
        x = np.concatenate([self._packed(c, c.multisine.amplitudes / c.units) for c in self._models])
        for norm in norms:
            options = {"maxiter": iterations, "maxcor": 20}
            value = partial(self._value, norm=norm)
            result: Any = scipy.optimize.minimize(value, x, method="L-BFGS-B", jac=True, options=options)  # type: ignore[call-overload]
            x = result.x
        return self._score(x)

    def _score(self, x: Array) -> Solution:
        information, multisines = self._base_information.copy(), []
        for model, u in zip(self._models, self._unpacked(x), strict=True):
            u = u / model.reach(u)
            information += model.information(u)[0]
            multisines.append(replace(model.multisine, amplitudes=u * model.units))
        logs = self._objective.logs(information)
        return Solution(tuple(multisines), information, self._objective.value(logs))

    def _value(self, x: Array, norm: float) -> tuple[float, Array]:
        information, contributions = self._base_information.copy(), []
        for model, u in zip(self._models, self._unpacked(x), strict=True):
            smooth_reach, of_spent = model.smooth_reach(u, norm)
            u = u / smooth_reach
            tone_information, y = model.information(u)
            information += tone_information
            contributions.append((model, smooth_reach, of_spent, tone_information, y))
        value, weights = self._objective.slope(self._objective.logs(information))
        Z = self._objective.dual(information, weights)
        slopes = []
        for model, smooth_reach, of_spent, tone_information, y in contributions:
            of_u = (
                model.slope(Z, y) / smooth_reach
                - 2 * float(np.sum(Z * tone_information)) / smooth_reach * of_spent
            )
            slopes.append(self._packed(model, -0.5 * of_u))
        return value, np.concatenate(slopes)

    @staticmethod
    def _packed(model: MultisineModel, u: Complex) -> Array:
        amplitudes = u[model.multisine.used]
        return np.concatenate([amplitudes.real, amplitudes.imag])

    def _unpacked(self, x: Array) -> list[Complex]:
        unpacked, offset = [], 0
        for model in self._models:
            used = model.multisine.used
            n = int(used.sum())
            u = np.zeros(used.shape, dtype=np.complex128)
            u[used] = x[offset : offset + n] + 1j * x[offset + n : offset + 2 * n]
            unpacked.append(u)
            offset += 2 * n
        return unpacked


def evaluate(multisines: Sequence[Multisine], base_information: Array, objective: Objective) -> Solution:
    """Return the solution that given tones are, without changing them."""
    information = base_information.copy()
    for multisine in multisines:
        model = MultisineModel(multisine)
        information += model.information(multisine.amplitudes / model.units)[0]
    return Solution(tuple(multisines), information, objective.value(objective.logs(information)))


def prune(multisines: Sequence[Multisine], max_tones: int) -> tuple[Multisine, ...]:
    """Return the experiments with at most so many tones in each loop, those kept that cost most."""
    pruned = []
    for multisine in multisines:
        size = np.abs(multisine.amplitudes) / MultisineModel(multisine).units
        order = np.argsort(np.argsort(-size, axis=0), axis=0)
        used = multisine.used & (order < max_tones)
        rows = used.any(axis=1)
        pruned.append(
            replace(
                multisine,
                number=multisine.number[rows],
                used=used[rows],
                amplitudes=np.where(used, multisine.amplitudes, 0)[rows],
            )
        )
    return tuple(pruned)


def steps(max_tones: int) -> int:
    """Return how many steps `compose` takes to so many tones."""
    return 3 + sum(size > max_tones for size in STEPS)


def compose(
    multisines: Sequence[Multisine],
    base_information: Array,
    objective: Objective,
    max_tones: int,
    on_value: Callable[[float], None],
) -> Solution:
    """Return few tones: seek amplitudes, drop the least, and again."""
    solution = MultisineProblem(multisines, base_information, objective).improve(NORMS, COMPOSE_ITERATIONS)
    on_value(solution.value)
    return _prune_stepwise(
        solution, base_information, objective, (*(n for n in STEPS if n > max_tones), max_tones), on_value
    )


def exchange(
    multisines: Sequence[Multisine],
    base_information: Array,
    objective: Objective,
    max_tones: int,
    on_value: Callable[[float], None],
) -> Solution:
    """Return few tones where many faint ones joined those there were: better ones take their places."""
    solution = MultisineProblem(multisines, base_information, objective).improve(
        EXCHANGE_NORMS, EXCHANGE_ITERATIONS
    )
    return _prune_stepwise(
        solution, base_information, objective, (max_tones + EXCHANGED_TONES, max_tones), on_value
    )


def _prune_stepwise(
    solution: Solution,
    base_information: Array,
    objective: Objective,
    sizes: Sequence[int],
    on_value: Callable[[float], None],
) -> Solution:
    """Drop the least tones, down to one size after another, then finish those that are left."""
    for size in sizes:
        solution = MultisineProblem(prune(solution.multisines, size), base_information, objective).improve(
            PRUNING_NORMS, PRUNE_ITERATIONS
        )
        on_value(solution.value)
    return polish(solution.multisines, base_information, objective, on_value)


def polish(
    multisines: Sequence[Multisine],
    base_information: Array,
    objective: Objective,
    on_value: Callable[[float], None],
) -> Solution:
    """Return the tones with the best amplitudes and phases, peaks as they are."""
    solution = MultisineProblem(multisines, base_information, objective).improve(
        (16.0, *FINAL_NORMS), POLISH_ITERATIONS
    )
    on_value(solution.value)
    return solution
