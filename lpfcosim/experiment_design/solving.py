"""The convex programme as the solver takes it, on a grid of frequencies."""

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lpfcosim.errors import InputError, RunError
from lpfcosim.experiment_design.objective import Objective
from lpfcosim.experiment_design.stage import Stage

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Hours:
    """Time that the experiments share.

    Attributes
    ----------
    total : float
        Of all [s].
    shortest : ndarray, shape (n,)
        Of each stage [s].
    """

    total: float
    shortest: Array


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


@dataclass(frozen=True)
class Solved:
    """What the solver found: `duals` are those of ``I - s_i e_i e_i^T``, shape (W, P, P)."""

    information: Array
    powers: tuple[Complex, ...]
    durations: Array
    multipliers: tuple[Array, ...]
    duals: Array


def _basis(size: int) -> Complex:
    """Return a real basis of Hermitian matrices, shape (size^2, size, size)."""
    found = []
    for i, j in combinations_with_replacement(range(size), 2):
        for unit in (1.0,) if i == j else (1.0, 1j):
            matrix = np.zeros((size, size), dtype=np.complex128)
            matrix[i, j], matrix[j, i] = unit, np.conj(unit)
            found.append(matrix)
    return np.array(found)


def whitened(stage: Stage, frequency: Array) -> tuple[Complex, Complex, Complex]:
    """Return what tones tell and cost, in units in which a tone of one costs about one, and these units."""
    told, cost = stage.responses(frequency)
    total = np.einsum("nyi,nyj->nij", cost.conj(), cost)
    units = np.asarray(np.linalg.inv(np.linalg.cholesky(total)).conj().transpose(0, 2, 1), np.complex128)
    return told @ units, cost @ units, units


class _Programme:
    """The convex programme on grids of frequencies, as the solver takes it: `turn` combines parameters."""

    def __init__(
        self,
        stages: Sequence[Stage],
        parts: Sequence[tuple[Complex, Complex, Complex]],
        fixed: Array,
        objective: Objective,
        hours: Hours | None,
        turn: Array,
    ) -> None:
        self._cp = cp = solver()
        self._objective = objective
        self._stages = stages
        P = len(fixed)
        self._turn = turn
        total: Any = turn @ fixed @ turn.T
        self._constraints: list[Any] = []
        last = np.array([stage.sight.duration for stage in stages])
        self._times = times = cp.Variable(len(stages)) if hours else np.ones(len(stages))  # of those planned
        if hours:
            self._constraints += [times >= hours.shortest / last, last @ times / hours.total <= 1]
        self._limits: list[Any] = []
        self._powers: list[tuple[Any, Complex, Complex]] = []
        for n, (stage, (told, cost, units)) in enumerate(zip(stages, parts, strict=True)):
            told = turn @ told
            total = total + (turn @ stage.known @ turn.T) * times[n]
            basis = _basis(told.shape[2])
            x = cp.Variable((len(told), len(basis)))
            flat = cp.reshape(x, (x.size,), order="C")
            of = np.einsum("npi,bij,nqj->pqnb", told.conj(), basis, told, optimize=True).real
            of = of.reshape(P * P, -1) * 2 * stage.sight.duration
            total = total + cp.reshape(of @ flat, (P, P), order="C")
            spent = np.einsum("nyi,bij,nyj->ynb", cost.conj(), basis, cost, optimize=True).real
            self._limits.append(spent.reshape(len(stage.bounds), -1) @ flat <= times[n])
            self._constraints += [self._limits[-1], *_semidefinite(cp, x, basis)]
            self._powers.append((x, basis, units))
        self._information = cp.Variable((P, P), symmetric=True)
        self._constraints.append(self._information == total)

    def solve(self) -> Solved:
        """Solve it.

        Raises
        ------
        InputError
            If no design is as good as asked.
        RunError
            If the solver fails.
        """
        cp, objective = self._cp, self._objective
        corners = self._turn[:, objective.wanted].T
        size = np.sum(corners**2, axis=1)  # over this s is of the order of one
        s = cp.Variable(objective.wanted.size)
        parts = [
            self._information - s[k] * np.outer(row, row) / size[k] >> 0 for k, row in enumerate(corners)
        ]
        goal = cp.min(cp.multiply(s, 1 / size)) if objective.worst else objective.weights @ cp.log(s)
        held = s >= size / objective.most**2
        problem = cp.Problem(cp.Maximize(goal), [*self._constraints, *parts, held])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of accuracy, which the certificate judges
                problem.solve(solver=cp.CLARABEL)
        except cp.error.SolverError as error:
            raise RunError(f"the convex solver failed: {error}") from None
        if problem.status in ("infeasible", "infeasible_inaccurate"):
            raise InputError("no design within the limits makes all sigmas as small as is asked")
        if problem.status not in ("optimal", "optimal_inaccurate"):
            raise RunError(f"the convex solver ended with {problem.status}")
        back = np.linalg.inv(self._turn)
        times = np.asarray(getattr(self._times, "value", self._times))
        return Solved(
            information=np.asarray(back @ self._information.value @ back.T),
            powers=tuple(
                _power(x.value / t, basis, units)
                for t, (x, basis, units) in zip(times, self._powers, strict=True)
            ),
            durations=times * [stage.sight.duration for stage in self._stages],
            multipliers=tuple(np.maximum(np.atleast_1d(limit.dual_value), 0) for limit in self._limits),
            duals=np.array([self._turn.T @ _positive(np.asarray(p.dual_value)) @ self._turn for p in parts]),
        )


def solution(
    stages: Sequence[Stage],
    grids: Sequence[Array],
    fixed: Array,
    objective: Objective,
    hours: Hours | None,
    like: Array | None = None,
) -> Solved:
    """Solve the programme.

    Parameters may be correlated to five digits, at which a solver loses its own. It is given combinations of
    them that are told alike: by the information `like` of a solution, if one is known, or by an even spread
    of power. Only where no solution is found otherwise are parameters as they are.

    Raises
    ------
    InputError
        If no design is as good as asked.
    RunError
        If the solver fails.
    """
    parts = [whitened(stage, grid) for stage, grid in zip(stages, grids, strict=True)]
    turns = [_alike(_even(stages, parts, fixed)), np.eye(len(fixed))]
    if like is not None:
        turns.insert(0, _alike(like))
    for turn in turns[:-1]:
        with suppress(RunError):
            return _Programme(stages, parts, fixed, objective, hours, turn).solve()
    return _Programme(stages, parts, fixed, objective, hours, turns[-1]).solve()


def _alike(information: Array) -> Array:
    """Return the combinations of parameters that this information tells alike, shape (P, P)."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(information)))


def _even(stages: Sequence[Stage], parts: Sequence[tuple[Complex, Complex, Complex]], fixed: Array) -> Array:
    """Return the information of an even spread of power, shape (P, P)."""
    total = fixed + sum(stage.known for stage in stages)
    for stage, (told, _, _) in zip(stages, parts, strict=True):
        n, _, loops = told.shape
        total += np.einsum("npl,nql->pq", told.conj(), told).real * 2 * stage.sight.duration / (n * loops)
    return np.asarray(total)


def _semidefinite(cp: Any, x: Any, basis: Complex) -> list[Any]:
    """Return the constraints that make powers out of coefficients of a basis."""
    size = basis.shape[1]
    if size == 1:
        return [x >= 0]
    if size == 2:  # a cone of second order is all that it takes
        first, real, imaginary, second = x[:, 0], x[:, 1], x[:, 2], x[:, 3]
        return [cp.SOC(first + second, cp.vstack([2 * real, 2 * imaginary, first - second]), axis=0)]
    doubled = np.array([np.block([[b.real, -b.imag], [b.imag, b.real]]) for b in basis])
    flat = doubled.reshape(len(basis), -1)
    return [cp.reshape(x[k] @ flat, (2 * size, 2 * size), order="C") >> 0 for k in range(x.shape[0])]


def _power(x: Array, basis: Complex, units: Complex) -> Complex:
    power = np.tensordot(x, basis, 1)
    return np.asarray(np.einsum("nij,njk,nlk->nil", units, power, units.conj()))


def _positive(matrix: Array) -> Array:
    """Return the nearest positive semidefinite matrix."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0)) @ vectors.T)
