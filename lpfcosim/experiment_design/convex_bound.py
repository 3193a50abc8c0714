"""The convex programme: the power by frequency with the most information within limits on rms, certified.

Of every experiment the information is linear in the powers of the tones, and so are the mean squares of what
is limited. A limit on a peak or a slew is one on the rms too: no signal has a larger rms than peak. With
``I - s_i e_i e_i^T`` positive semidefinite, ``s_i`` is at most one over the square of sigma_i, and maximising
``sum w_i log s_i`` is convex. A tone drives one loop, or several with fixed amplitudes and phases to each
other; each has one power.

Any Z >= 0 and multipliers mu bound the objective from the other side. Those of the programme are made
feasible on a grid twenty times as fine, so that the bound does not depend on the few tones of the programme.
The best tones there join the programme in the next round.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import InputError, RunError
from lpfcosim.experiment_design.design_problem import DesignProblem, Objective
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

COARSE_GRID, FINE_GRID = 30, 600  # frequencies
ROUNDS = 3  # of adding frequencies with more information
MIN_POWER = 1e-4  # of the largest power, below which a frequency is left out
TOLERANCE = 1e-4  # relative gain of information at a frequency that is added
PRICE_OFFSETS = (1e-6, 1e-4, 1e-3, 1e-2)  # prices, relative to the highest


@dataclass(frozen=True)
class Optimum:
    """The best power.

    Attributes
    ----------
    value : float
        The objective, see `Objective.value`.
    bound : float
        What no design within the limits on rms goes below.
    sigma_bounds : ndarray, shape (W,)
        What the sigma of each parameter that counts does not go below, in units of its scale.
    frequencies : tuple of ndarray, each of shape (n,)
        Of every experiment [Hz].
    amplitudes : tuple of ndarray, each of shape (n, L)
        Of a tone of that power in each of its loops.
    """

    value: float
    bound: float
    sigma_bounds: Array
    frequencies: tuple[Array, ...]
    amplitudes: tuple[Array, ...]


@dataclass(frozen=True)
class _Tones:
    """Tones of an experiment that cost about one: frequencies (K,) [Hz], amplitudes in its loops (K, L)."""

    frequency: Array
    amplitudes: Complex

    def __getitem__(self, index: NDArray[Any]) -> "_Tones":
        return _Tones(self.frequency[index], self.amplitudes[index])

    def __add__(self, other: "_Tones") -> "_Tones":
        frequency = np.concatenate([self.frequency, other.frequency])
        return _Tones(frequency, np.concatenate([self.amplitudes, other.amplitudes]))

    def responses(self, experiment: DesignedExperiment) -> tuple[Complex, Complex]:
        """Return sensitivities (K, P) and costs (K, limits)."""
        frequency, row = np.unique(self.frequency, return_inverse=True)
        sensitivity, cost = experiment.responses(frequency)
        u = self.amplitudes[:, :, None]
        return (sensitivity[row] @ u)[..., 0], (cost[row] @ u)[..., 0]


@dataclass(frozen=True)
class _ProgrammeSolution:
    """What the solver found: `duals` are those of ``I - s_i e_i e_i^T``, shape (W, P, P)."""

    information: Array
    powers: tuple[Array, ...]
    multipliers: tuple[Array, ...]
    duals: Array


def optimize_power(problem: DesignProblem, on_bound: Callable[[float, float], None] | None = None) -> Optimum:
    """Return the power that minimises the objective, and the bound.

    Parameters
    ----------
    problem : DesignProblem
        The experiments, and what counts.
    on_bound : callable, optional
        Called with value and bound after each round.

    Raises
    ------
    InputError
        If no frequency is allowed, or the solver is missing.
    RunError
        If it fails.
    """
    forbidden, experiments = problem.plan.design.forbidden, problem.experiments
    fine = [_CertificateGrid(e, e.frequencies(FINE_GRID, forbidden)) for e in experiments]
    tones = [grid.single_loop_tones(FINE_GRID // COARSE_GRID) for grid in fine]
    bound, sigma_bounds = 0.0, np.zeros(problem.objective.indices.size)
    reference: Array | None = None
    for _ in range(ROUNDS):
        solution = _solve(problem, tones, reference)
        reference = solution.information
        value = problem.objective.value(solution.information)
        certified, sigmas, added = _certify(solution, fine, problem)
        bound, sigma_bounds = max(bound, certified), np.maximum(sigma_bounds, sigmas)
        if on_bound:
            on_bound(value, bound)
        strong = [x > MIN_POWER * x.max() for x in solution.powers]
        largest_tones = [
            (one.frequency[k], np.sqrt(2 * x[k])[:, None] * np.abs(one.amplitudes[k]))
            for one, x, k in zip(tones, solution.powers, strong, strict=True)
        ]
        tones = [one[k] + extra for one, k, extra in zip(tones, strong, added, strict=True)]
    frequencies, amplitudes = zip(*largest_tones, strict=True)
    return Optimum(value, bound, sigma_bounds, frequencies, amplitudes)


def solver() -> Any:
    """Return the convex solver.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        import cvxpy
    except ImportError:
        raise InputError("design needs a convex solver: pip install 'lpfcosim[design]'") from None
    return cvxpy


def _solve(problem: DesignProblem, tones: Sequence[_Tones], reference: Array | None) -> _ProgrammeSolution:
    """Solve the programme for the powers of some tones.

    Parameters may be correlated to five digits, at which a solver loses its own. It is given combinations of
    them with equal information: by `reference`, or by an even spread of power.

    Raises
    ------
    RunError
        If the solver fails.
    """
    cp, objective, base = solver(), problem.objective, problem.base_information
    responses = [one.responses(e) for one, e in zip(tones, problem.experiments, strict=True)]
    seconds = [e.model.duration for e in problem.experiments]
    rows = [np.sqrt(2 * T) * D for T, (D, _) in zip(seconds, responses, strict=True)]
    if reference is None:
        reference = base + sum((D.conj().T @ D).real / len(D) for D in rows)
    transform = np.linalg.inv(np.linalg.cholesky(reference))
    total: Any = transform @ base @ transform.T
    powers, limits = [], []
    for D, (_, cost) in zip(rows, responses, strict=True):
        x = cp.Variable(len(D), nonneg=True)
        combined = D @ transform.T
        information = np.einsum("kp,kq->pqk", combined.conj(), combined).real
        total = total + cp.reshape(information.reshape(-1, len(D)) @ x, base.shape, order="C")
        limits.append((np.abs(cost) ** 2).T @ x <= 1)
        powers.append(x)
    information = cp.Variable(base.shape, symmetric=True)
    corners = transform[:, objective.indices].T
    size = np.sum(corners**2, axis=1)  # over this s is of the order of one
    s = cp.Variable(size.size)
    margins = [information - s[k] * np.outer(row, row) / size[k] >> 0 for k, row in enumerate(corners)]
    goal = cp.Maximize(objective.weights @ cp.log(s))
    programme = cp.Problem(goal, [*limits, *margins, information == total])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of accuracy, which the certificate judges
            programme.solve(solver=cp.CLARABEL)
    except cp.error.SolverError as error:
        raise RunError(f"the convex solver failed: {error}") from None
    if programme.status not in ("optimal", "optimal_inaccurate"):
        raise RunError(f"the convex solver ended with {programme.status}")
    back = np.linalg.inv(transform)
    return _ProgrammeSolution(
        information=np.asarray(back @ information.value @ back.T),
        powers=tuple(np.maximum(x.value, 0) for x in powers),
        multipliers=tuple(np.maximum(np.atleast_1d(limit.dual_value), 0) for limit in limits),
        duals=np.array([transform.T @ _positive(np.asarray(m.dual_value)) @ transform for m in margins]),
    )


def _positive(matrix: Array) -> Array:
    """Return the nearest positive semidefinite matrix."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0)) @ vectors.T)


class _CertificateGrid:
    """An experiment on the grid of the certificate."""

    def __init__(self, experiment: DesignedExperiment, frequency: Array) -> None:
        if not frequency.size:
            raise InputError(
                f"design.forbidden: experiment {experiment.run.experiment} has no frequency left"
            )
        self.experiment, self.frequency = experiment, frequency
        sensitivity, cost = experiment.responses(frequency)
        self._units = 1 / np.sqrt(np.sum(np.abs(cost) ** 2, axis=1))  # (n, L), of tones that cost about one
        self._sensitivity, self._cost = sensitivity * self._units[:, None], cost * self._units[:, None]

    def single_loop_tones(self, step: int) -> _Tones:
        """Return tones in one loop at every so many frequencies of the grid."""
        units = self._units[::step]
        amplitudes = units[:, :, None] * np.eye(units.shape[1])
        return _Tones(
            np.repeat(self.frequency[::step], units.shape[1]), amplitudes.reshape(-1, units.shape[1])
        )

    def valuable_tones(self, amplitudes: Complex, gain: Array) -> _Tones:
        """Return the best tones at those frequencies at which they add most information."""
        inner = (gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:]) & (gain[1:-1] > 1 + TOLERANCE)
        return _Tones(self.frequency, amplitudes * self._units)[1 + np.flatnonzero(inner)]

    def max_information(self, dual: Array, multipliers: Array) -> tuple[float, Array, Complex]:
        """Return the largest information of any tones, and by frequency the best tone and its gain.

        The gain (n,) is information over cost at the multipliers; the amplitudes (n, L) of the best tones are
        in units in which they cost about one.

        Any prices of the limits do. Those of the solver are right to some digits only, and what hardly has a
        price would make tones free: of those that are raised a little the best are taken.
        """
        bounds = []
        for offset in PRICE_OFFSETS:
            mu = multipliers + offset * multipliers.max()
            gain, amplitudes = self._dearest(dual, mu)
            bounds.append((float(gain.max() * mu.sum()), gain, amplitudes))
        return min(bounds, key=lambda one: one[0])

    def _dearest(self, dual: Array, multipliers: Array) -> tuple[Array, Complex]:
        """Return, by frequency, information over cost at the multipliers of the best tone, and this tone."""
        D, cost = self._sensitivity, self._cost
        K = np.einsum("npi,pq,nqj->nij", D.conj(), dual, D, optimize=True)
        A = np.einsum("nyi,y,nyj->nij", cost.conj(), multipliers, cost, optimize=True)
        root = np.linalg.inv(np.linalg.cholesky(A))
        values, vectors = np.linalg.eigh(root @ K @ root.conj().transpose(0, 2, 1))
        amplitudes = (root.conj().transpose(0, 2, 1) @ vectors[:, :, -1:])[..., 0]
        amplitudes /= np.linalg.norm(amplitudes, axis=1, keepdims=True)
        return values[:, -1] * 2 * self.experiment.model.duration, amplitudes


def _certify(
    solution: _ProgrammeSolution, fine: Sequence[_CertificateGrid], problem: DesignProblem
) -> tuple[float, Array, list[_Tones]]:
    """Return the bounds of objective and sigmas, and tones that would add information.

    Of every design ``sum z_i s_i <= <Z, I> <= total``; under that, `_min_objective` finds the best s.
    """
    objective = problem.objective

    def max_trace(Z: Array) -> tuple[float, list[_Tones]]:
        """Return the largest ``<Z, I>`` of any design."""
        total, added = float(np.sum(Z * problem.base_information)), []
        for grid, mu in zip(fine, solution.multipliers, strict=True):
            tones, gain, amplitudes = grid.max_information(Z, mu)
            total += tones
            added.append(grid.valuable_tones(amplitudes, gain))
        return total, added

    total, added = max_trace(solution.duals.sum(axis=0))
    weights = solution.duals[np.arange(objective.indices.size), objective.indices, objective.indices]
    totals = [max_trace(Z)[0] for Z in solution.duals]
    return _min_objective(weights, total, objective), np.sqrt(weights / totals), added


def _min_objective(z: Array, total: float, objective: Objective) -> float:
    """Return the least objective of all s, one over squares of sigmas, with ``z s <= total``."""
    s = total * objective.weights / z
    return float(np.exp(-0.5 * objective.weights @ np.log(s)))
