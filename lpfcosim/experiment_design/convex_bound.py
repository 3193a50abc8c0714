"""The convex programme: the power by frequency with the most information within limits on rms, certified.

Of every experiment the information is linear in the cross powers ``Phi(f)`` of the tones, and so are the mean
squares of what is limited. A limit on a peak or a slew is one on the rms too: no signal has a larger rms than
peak. With ``I - s_i e_i e_i^T`` positive semidefinite, ``s_i`` is at most one over the square of sigma_i, and
maximising ``sum w_i log s_i`` or ``min s_i`` is convex.

Any Z >= 0 and multipliers mu bound the objective from the other side. Those of the programme are made
feasible on a grid twenty times as fine, so that the bound does not depend on the few frequencies of the
programme.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lpfcosim.experiment_design.cvxpy_problem import ProgrammeSolution, TimeBudget, solve_program, whiten
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.objective import Objective

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Bands = Sequence[tuple[float, float]]

COARSE_GRID, FINE_GRID = 30, 600  # frequencies
ROUNDS = 3  # of adding frequencies with more information
MIN_POWER = 1e-4  # of the largest power, below which a frequency is left out
TOLERANCE = 1e-4  # relative gain of information at a frequency that is added
MAX_GAP = 5e-4  # gap that is small enough
PRICE_OFFSETS = (1e-6, 1e-4, 1e-3, 1e-2)  # prices, relative to the highest
MIXING = 0.01  # of the best information, added where one parameter alone counts


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


def optimize_power(
    experiments: Sequence[DesignedExperiment],
    prior_information: Array,
    objective: Objective,
    forbidden: Bands,
    on_bound: Callable[[float, float], None] | None = None,
    rounds: int = ROUNDS,
    budget: TimeBudget | None = None,
) -> Optimum:
    """Return the power that minimises the objective, and the bound.

    Parameters
    ----------
    experiments : sequence of DesignedExperiment
        The experiments.
    prior_information : ndarray, shape (P, P)
        Information in addition to them: weak priors, and the experiments without tones.
    objective : Objective
        What counts.
    forbidden : sequence of tuple of float
        Bands without tones [Hz].
    on_bound : callable, optional
        Called with value and bound after each round.
    rounds : int
        Largest number of rounds of adding frequencies; the bound holds after any.
    budget : TimeBudget, optional
        To be shared out; otherwise every experiment lasts as long as it does.

    Raises
    ------
    InputError, RunError
        If no design is as good as asked, or the solver is missing; if it fails.
    """
    grids = [experiment.frequencies(COARSE_GRID, forbidden) for experiment in experiments]
    fine = [
        _CertificateGrid(experiment, experiment.frequencies(FINE_GRID, forbidden))
        for experiment in experiments
    ]
    optimum: Optimum | None = None
    for _ in range(rounds):
        solved = solve_program(
            experiments, grids, prior_information, objective, budget, optimum.information if optimum else None
        )
        bound, added = _certify(solved, fine, prior_information, objective, budget)
        bound = max(bound, optimum.bound) if optimum else bound
        value = objective.value(objective.logs(solved.information))
        dual = solved.duals.sum(axis=0)
        optimum = Optimum(
            solved.information, value, bound, tuple(grids), solved.powers, solved.durations, dual
        )
        if on_bound:
            on_bound(value, bound)
        if optimum.gap < MAX_GAP:
            break
        used = _strong_frequencies(experiments, optimum)
        grids = [np.unique(np.concatenate(arrays)) for arrays in zip(used, added, strict=True)]
    assert optimum is not None
    return optimum


def _strong_frequencies(experiments: Sequence[DesignedExperiment], optimum: Optimum) -> list[Array]:
    """Return the frequencies with power worth mentioning, by stage: with few of them a solver does better."""
    frequencies = []
    for experiment, frequency, power in zip(experiments, optimum.frequencies, optimum.powers, strict=True):
        cost = experiment.responses(frequency)[1]
        spent = np.einsum("nyi,nij,nyj->ny", cost, power, cost.conj()).real.max(axis=1)
        frequencies.append(frequency[spent > MIN_POWER * spent.max()])
    return frequencies


def single_parameter_bounds(
    experiments: Sequence[DesignedExperiment],
    prior_information: Array,
    objective: Objective,
    optimum: Optimum,
    forbidden: Bands,
) -> Iterator[float]:
    """Yield what the sigma of each parameter that counts does not go below, whatever becomes of the others.

    A design for one need not determine the others at all, and then no solver copes. A little of what the best
    power for all determines is added in what is solved, and left out of the bound.

    Parameters
    ----------
    stages, fixed, objective, forbidden
        As those of `optimize_power`.
    optimum : Optimum
        The best power for all.

    Raises
    ------
    RunError
        If the solver fails.
    """
    grids = [experiment.frequencies(COARSE_GRID, forbidden) for experiment in experiments]
    fine = [
        _CertificateGrid(experiment, experiment.frequencies(FINE_GRID, forbidden))
        for experiment in experiments
    ]
    initial_tones = prior_information + MIXING * optimum.information
    for i in objective.indices:
        only = Objective(np.array([i]), np.ones(1), minimax=False, max_ratios=np.full(1, np.inf))
        solved = solve_program(experiments, grids, initial_tones, only, None, optimum.information)
        (Z,) = solved.duals
        yield float(np.sqrt(Z[i, i] / _max_trace(Z, solved, fine, prior_information, None)[0]))


class _CertificateGrid:
    """A stage on the grid of the certificate."""

    def __init__(self, experiment: DesignedExperiment, frequency: Array) -> None:
        self.experiment, self.frequency = experiment, frequency
        self._sensitivity, self._cost, _ = whiten(experiment, frequency)

    def max_information(self, dual: Array, multipliers: Array) -> tuple[float, Array]:
        """Return the largest information of any tones, and of the best tone over its cost by frequency.

        Any prices of the limits do. Those of the solver are right to some digits only, and what hardly has a
        price would make tones free: of those that are raised a little the best are taken.
        """
        bounds = []
        for offset in PRICE_OFFSETS:
            mu = multipliers + offset * multipliers.max()
            gain = self._dearest(dual, mu)
            bounds.append((float(gain.max() * mu.sum()), gain))
        return min(bounds, key=lambda one: one[0])

    def _dearest(self, dual: Array, multipliers: Array) -> Array:
        """Return, by frequency, the information of the best tone over its cost at the multipliers."""
        K = np.einsum("npi,pq,nqj->nij", self._sensitivity.conj(), dual, self._sensitivity, optimize=True)
        A = np.einsum("nyi,y,nyj->nij", self._cost.conj(), multipliers, self._cost, optimize=True)
        root = np.linalg.inv(np.linalg.cholesky(A))
        gain = np.linalg.eigvalsh(root @ K @ root.conj().transpose(0, 2, 1))[:, -1]
        return np.asarray(gain * 2 * self.experiment.model.duration)


def _certify(
    solved: ProgrammeSolution,
    fine: Sequence[_CertificateGrid],
    prior_information: Array,
    objective: Objective,
    budget: TimeBudget | None,
) -> tuple[float, list[Array]]:
    """Return the bound of the objective, and frequencies at which tones would add information.

    Of every design ``sum z_i s_i <= <Z, I> <= total``; under that, `_min_objective` finds the best s.
    """
    total, gains = _max_trace(solved.duals.sum(axis=0), solved, fine, prior_information, budget)
    added = []
    for grid, gain in zip(fine, gains, strict=True):
        inner = (gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:]) & (gain[1:-1] > 1 + TOLERANCE)
        added.append(grid.frequency[1:-1][inner])
    weights = solved.duals[np.arange(objective.indices.size), objective.indices, objective.indices]
    return _min_objective(weights, total, objective), added


def _max_trace(
    Z: Array,
    solved: ProgrammeSolution,
    fine: Sequence[_CertificateGrid],
    prior_information: Array,
    budget: TimeBudget | None,
) -> tuple[float, list[Array]]:
    """Return the largest ``<Z, I>`` of any design, and information over cost of tones by frequency.

    The information of an experiment grows with its time. What is left of the time beyond the shortest is thus
    worth most in one experiment.
    """
    rates, gains = [], []
    for grid, mu in zip(fine, solved.multipliers, strict=True):
        tones, gain = grid.max_information(Z, mu)
        gains.append(gain)
        rates.append(
            (float(np.sum(Z * grid.experiment.base_information)) + tones) / grid.experiment.model.duration
        )
    rate = np.array(rates)
    if budget is None:
        value = float(rate @ [grid.experiment.model.duration for grid in fine])
    else:
        value = float(rate @ budget.min_durations + rate.max() * (budget.total - budget.min_durations.sum()))
    return float(np.sum(Z * prior_information)) + value, gains


def _min_objective(z: Array, total: float, objective: Objective) -> float:
    """Return the least objective of all s, one over squares of sigmas, with ``z s <= total``."""
    if objective.minimax:
        return float(np.sqrt(z.sum() / total))
    floor = 1 / objective.max_ratios**2

    def s(level: float) -> Array:
        return np.maximum(level * objective.weights / z, floor)

    low, high = 0.0, total / float(objective.weights.sum())
    for _ in range(200):  # s grows with the level
        middle = (low + high) / 2
        low, high = (middle, high) if z @ s(middle) < total else (low, middle)
    return float(np.exp(-0.5 * objective.weights @ np.log(s(high))))
