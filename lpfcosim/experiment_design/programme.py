"""The convex programme: which power at which frequency tells most within limits on rms, and a certificate.

Of every experiment the information is linear in the cross powers ``Phi(f)`` of the tones, and so are the mean
squares of what is limited. A limit on a peak or a slew is one on the rms too: no signal has a larger rms than
peak. With ``I - s_i e_i e_i^T`` positive semidefinite, ``s_i`` is at most one over the square of sigma_i, and
maximising ``sum w_i log s_i`` or ``min s_i`` is convex.

Any Z >= 0 and multipliers mu bound the objective from the other side. Those of the programme are made
feasible on a grid twenty times as fine, so that the bound does not rest on the few frequencies of the
programme.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.objective import Objective
from lpfcosim.experiment_design.solving import Hours, Solved, solution, whitened
from lpfcosim.experiment_design.stage import Stage

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Bands = Sequence[tuple[float, float]]

COARSE, FINE = 30, 600  # frequencies
ROUNDS = 3  # of adding the frequencies at which more could be told
LITTLE = 1e-4  # of the largest power, below which a frequency is left out
TOLERANCE = 1e-4  # relative, of what more could be told at a frequency that is added
CLOSE = 5e-4  # gap that is small enough
RAISED = (1e-6, 1e-4, 1e-3, 1e-2)  # prices, relative to the highest
A_LITTLE = 0.01  # of what is told at best, where one parameter is to count alone


@dataclass(frozen=True)
class Optimum:
    """The best power.

    Attributes
    ----------
    information : ndarray, shape (P, P)
        Scaled.
    value : float
        The objective, see `Objective.value`.
    bound : float
        What no design within the limits on rms goes below.
    frequencies : tuple of ndarray, each of shape (n,)
        Of every stage [Hz].
    powers : tuple of ndarray, each of shape (n, L, L)
        Cross powers of its loops there: mean squares and products over the run.
    durations : ndarray, shape (n,)
        Of every stage [s].
    dual : ndarray, shape (P, P)
        Z: what a change of the information is worth.
    """

    information: Array
    value: float
    bound: float
    frequencies: tuple[Array, ...]
    powers: tuple[Complex, ...]
    durations: Array
    dual: Array

    @property
    def gap(self) -> float:
        """How far the value may be from the best, relative."""
        return self.value / self.bound - 1


def optimum(
    stages: Sequence[Stage],
    fixed: Array,
    objective: Objective,
    forbidden: Bands,
    told: Callable[[float, float], None] | None = None,
    rounds: int = ROUNDS,
    hours: Hours | None = None,
) -> Optimum:
    """Return the power that tells most, and the bound.

    Parameters
    ----------
    stages : sequence of Stage
        The experiments.
    fixed : ndarray, shape (P, P)
        Information beside them: weak priors, and the experiments without tones.
    objective : Objective
        What counts.
    forbidden : sequence of tuple of float
        Bands without tones [Hz].
    told : callable, optional
        Is told value and bound after each round.
    rounds : int
        Of adding the frequencies at which more could be told, at most; the bound holds after any.
    hours : Hours, optional
        To be shared out; otherwise every experiment lasts as long as it does.

    Raises
    ------
    InputError
        If no design is as good as asked, or the solver is missing.
    RunError
        If the solver fails.
    """
    grids = [stage.frequencies(COARSE, forbidden) for stage in stages]
    fine = [_Fine(stage, stage.frequencies(FINE, forbidden)) for stage in stages]
    best: Optimum | None = None
    for _ in range(rounds):
        solved = solution(stages, grids, fixed, objective, hours, best.information if best else None)
        bound, more = _certified(solved, fine, fixed, objective, hours)
        bound = max(bound, best.bound) if best else bound
        value = objective.value(objective.logs(solved.information))
        best = Optimum(
            information=solved.information,
            value=value,
            bound=bound,
            frequencies=tuple(grids),
            powers=solved.powers,
            durations=solved.durations,
            dual=solved.duals.sum(axis=0),
        )
        if told:
            told(value, bound)
        if best.gap < CLOSE:
            break
        used = _used(stages, best)
        grids = [np.unique(np.concatenate(each)) for each in zip(used, more, strict=True)]
    assert best is not None
    return best


def _used(stages: Sequence[Stage], best: Optimum) -> list[Array]:
    """Return the frequencies with power worth mentioning, by stage: with few of them a solver does better."""
    found = []
    for stage, frequency, power in zip(stages, best.frequencies, best.powers, strict=True):
        cost = stage.responses(frequency)[1]
        spent = np.einsum("nyi,nij,nyj->ny", cost, power, cost.conj()).real.max(axis=1)
        found.append(frequency[spent > LITTLE * spent.max()])
    return found


def alone(
    stages: Sequence[Stage], fixed: Array, objective: Objective, best: Optimum, forbidden: Bands
) -> Iterator[float]:
    """Yield what the sigma of each parameter that counts does not go below, whatever becomes of the others.

    A design for one need not tell the others at all, and then no solver copes. A little of what the best
    power for all tells is added in what is solved, and left out of the bound.

    Parameters
    ----------
    stages, fixed, objective, forbidden
        As those of `optimum`.
    best : Optimum
        The best power for all.

    Raises
    ------
    RunError
        If the solver fails.
    """
    grids = [stage.frequencies(COARSE, forbidden) for stage in stages]
    fine = [_Fine(stage, stage.frequencies(FINE, forbidden)) for stage in stages]
    begun = fixed + A_LITTLE * best.information
    for i in objective.wanted:
        only = Objective(np.array([i]), np.ones(1), worst=False, most=np.full(1, np.inf))
        solved = solution(stages, grids, begun, only, None, best.information)
        (Z,) = solved.duals
        yield float(np.sqrt(Z[i, i] / _most(Z, solved, fine, fixed, None)[0]))


class _Fine:
    """A stage on the grid of the certificate."""

    def __init__(self, stage: Stage, frequency: Array) -> None:
        self.stage, self.frequency = stage, frequency
        self._told, self._cost, _ = whitened(stage, frequency)

    def worth(self, dual: Array, multipliers: Array) -> tuple[float, Array]:
        """Return what no tones tell more than, and by frequency what the best tone tells over its cost.

        Any prices of the limits do. Those of the solver are right to some digits only, and what hardly has a
        price would make tones free: of those that are raised a little the best are taken.
        """
        found = []
        for more in RAISED:
            mu = multipliers + more * multipliers.max()
            gain = self._dearest(dual, mu)
            found.append((float(gain.max() * mu.sum()), gain))
        return min(found, key=lambda one: one[0])

    def _dearest(self, dual: Array, multipliers: Array) -> Array:
        """Return, by frequency, what the best tone tells over what the multipliers have it cost."""
        K = np.einsum("npi,pq,nqj->nij", self._told.conj(), dual, self._told, optimize=True)
        A = np.einsum("nyi,y,nyj->nij", self._cost.conj(), multipliers, self._cost, optimize=True)
        root = np.linalg.inv(np.linalg.cholesky(A))
        gain = np.linalg.eigvalsh(root @ K @ root.conj().transpose(0, 2, 1))[:, -1]
        return np.asarray(gain * 2 * self.stage.sight.duration)


def _certified(
    solved: Solved, fine: Sequence[_Fine], fixed: Array, objective: Objective, hours: Hours | None
) -> tuple[float, list[Array]]:
    """Return the bound of the objective, and the frequencies at which more could be told.

    Of every design ``sum z_i s_i <= <Z, I> <= total``; under that, `_least` finds the best s.
    """
    total, gains = _most(solved.duals.sum(axis=0), solved, fine, fixed, hours)
    more = []
    for each, gain in zip(fine, gains, strict=True):
        inner = (gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:]) & (gain[1:-1] > 1 + TOLERANCE)
        more.append(each.frequency[1:-1][inner])
    of_wanted = solved.duals[np.arange(objective.wanted.size), objective.wanted, objective.wanted]
    return _least(of_wanted, total, objective), more


def _most(
    Z: Array, solved: Solved, fine: Sequence[_Fine], fixed: Array, hours: Hours | None
) -> tuple[float, list[Array]]:
    """Return what ``<Z, I>`` of no design goes beyond, and by frequency what tones tell over what they cost.

    All that an experiment tells grows with its time. What is left of the time beyond the shortest is thus
    worth most in one experiment.
    """
    rates, gains = [], []
    for each, mu in zip(fine, solved.multipliers, strict=True):
        tones, gain = each.worth(Z, mu)
        gains.append(gain)
        rates.append((float(np.sum(Z * each.stage.known)) + tones) / each.stage.sight.duration)
    rate = np.array(rates)
    if hours is None:
        told = float(rate @ [each.stage.sight.duration for each in fine])
    else:
        told = float(rate @ hours.shortest + rate.max() * (hours.total - hours.shortest.sum()))
    return float(np.sum(Z * fixed)) + told, gains


def _least(z: Array, total: float, objective: Objective) -> float:
    """Return the least objective of all s, one over squares of sigmas, with ``z s <= total``."""
    if objective.worst:
        return float(np.sqrt(z.sum() / total))
    floor = 1 / objective.most**2

    def s(level: float) -> Array:
        return np.maximum(level * objective.weights / z, floor)

    low, high = 0.0, total / float(objective.weights.sum())
    for _ in range(200):  # s grows with the level
        middle = (low + high) / 2
        low, high = (middle, high) if z @ s(middle) < total else (low, middle)
    return float(np.exp(-0.5 * objective.weights @ np.log(s(high))))
