"""The convex programme: which power at which frequency tells most within limits on rms, and a certificate.

Of every experiment the information is linear in the cross powers ``Phi(f)`` of the tones, and so are the mean
squares of what is limited. A limit on a peak or a slew is one on the rms too: no signal has a larger rms than
peak. With ``I - s_i e_i e_i^T`` positive semidefinite, ``s_i`` is at most one over the square of sigma_i, and
maximising ``sum w_i log s_i`` or ``min s_i`` is convex.

Any Z >= 0 and multipliers mu bound the objective from the other side. Those of the programme are made
feasible on a grid twenty times as fine, so that the bound does not rest on the few frequencies of the
programme.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lpfcosim.design.objective import Objective
from lpfcosim.design.stage import Stage
from lpfcosim.errors import InputError, RunError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Bands = Sequence[tuple[float, float]]

COARSE, FINE = 30, 600  # frequencies
ROUNDS = 3  # of adding the frequencies at which more could be told
TOLERANCE = 1e-4  # relative, of what more could be told


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
    dual : ndarray, shape (P, P)
        Z: what a change of the information is worth.
    """

    information: Array
    value: float
    bound: float
    frequencies: tuple[Array, ...]
    powers: tuple[Complex, ...]
    dual: Array

    @property
    def gap(self) -> float:
        """How far the value may be from the best, relative."""
        return self.value / self.bound - 1


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


def optimum(
    stages: Sequence[Stage],
    fixed: Array,
    objective: Objective,
    forbidden: Bands,
    told: Callable[[float, float], None] | None = None,
    rounds: int = ROUNDS,
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
        solved = _solved(stages, grids, fixed, objective)
        bound, more = _certified(solved, fine, fixed, objective)
        bound = max(bound, best.bound) if best else bound
        value = objective.value(objective.logs(solved.information))
        best = Optimum(
            solved.information, value, bound, tuple(grids), solved.powers, solved.duals.sum(axis=0)
        )
        if told:
            told(value, bound)
        if best.gap < TOLERANCE:
            break
        grids = [np.unique(np.concatenate([grid, found])) for grid, found in zip(grids, more, strict=True)]
    assert best is not None
    return best


@dataclass(frozen=True)
class _Solved:
    """What the solver found: `duals` are those of ``I - s_i e_i e_i^T``, shape (W, P, P)."""

    information: Array
    powers: tuple[Complex, ...]
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


def _whitened(stage: Stage, frequency: Array) -> tuple[Complex, Complex, Complex]:
    """Return what tones tell and cost, in units in which a tone of one costs about one, and these units."""
    told, cost = stage.responses(frequency)
    total = np.einsum("nyi,nyj->nij", cost.conj(), cost)
    units = np.asarray(np.linalg.inv(np.linalg.cholesky(total)).conj().transpose(0, 2, 1), np.complex128)
    return told @ units, cost @ units, units


class _Programme:
    """The convex programme on grids of frequencies, as the solver takes it.

    Parameters may be correlated to five digits, at which a solver may give up. It is then given combinations
    of them, of which an even spread of power would tell each as well as the others (`turned`).
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        grids: Sequence[Array],
        fixed: Array,
        objective: Objective,
        *,
        turned: bool,
    ) -> None:
        self._cp = cp = solver()
        self._objective = objective
        self._stages = stages
        P = len(fixed)
        parts = [_whitened(stage, grid) for stage, grid in zip(stages, grids, strict=True)]
        known = fixed + sum(stage.known for stage in stages)
        self._turn = turn = _turn(stages, parts, known) if turned else np.eye(P)
        total: Any = turn @ known @ turn.T
        self._constraints: list[Any] = []
        self._limits: list[Any] = []
        self._powers: list[tuple[Any, Complex, Complex]] = []
        for stage, (told, cost, units) in zip(stages, parts, strict=True):
            told = turn @ told
            basis = _basis(told.shape[2])
            x = cp.Variable((len(told), len(basis)))
            flat = cp.reshape(x, (x.size,), order="C")
            of = np.einsum("npi,bij,nqj->pqnb", told.conj(), basis, told, optimize=True).real
            of = of.reshape(P * P, -1) * 2 * stage.sight.duration
            total = total + cp.reshape(of @ flat, (P, P), order="C")
            spent = np.einsum("nyi,bij,nyj->ynb", cost.conj(), basis, cost, optimize=True).real
            self._limits.append(spent.reshape(len(stage.bounds), -1) @ flat <= 1)
            self._constraints += [self._limits[-1], *_semidefinite(cp, x, basis)]
            self._powers.append((x, basis, units))
        self._information = cp.Variable((P, P), symmetric=True)
        self._constraints.append(self._information == total)

    def solve(self) -> _Solved:
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
        return _Solved(
            information=np.asarray(back @ self._information.value @ back.T),
            powers=tuple(_power(x.value, basis, units) for x, basis, units in self._powers),
            multipliers=tuple(np.maximum(np.atleast_1d(limit.dual_value), 0) for limit in self._limits),
            duals=np.array([self._turn.T @ _positive(np.asarray(p.dual_value)) @ self._turn for p in parts]),
        )


def _solved(stages: Sequence[Stage], grids: Sequence[Array], fixed: Array, objective: Objective) -> _Solved:
    """Solve the programme, if need be in other combinations of the parameters."""
    try:
        return _Programme(stages, grids, fixed, objective, turned=False).solve()
    except RunError:
        return _Programme(stages, grids, fixed, objective, turned=True).solve()


def _turn(stages: Sequence[Stage], parts: Sequence[tuple[Complex, Complex, Complex]], known: Array) -> Array:
    """Return what makes combinations of parameters that even power tells alike, shape (P, P)."""
    total = known.copy()
    for stage, (told, _, _) in zip(stages, parts, strict=True):
        n, _, loops = told.shape
        total += np.einsum("npl,nql->pq", told.conj(), told).real * 2 * stage.sight.duration / (n * loops)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(total)))


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


class _Fine:
    """A stage on the grid of the certificate."""

    def __init__(self, stage: Stage, frequency: Array) -> None:
        self.stage, self.frequency = stage, frequency
        self._told, self._cost, _ = _whitened(stage, frequency)

    def dearest(self, dual: Array, multipliers: Array) -> Array:
        """Return, by frequency, what the best tone tells over what the multipliers have it cost."""
        K = np.einsum("npi,pq,nqj->nij", self._told.conj(), dual, self._told, optimize=True)
        A = np.einsum("nyi,y,nyj->nij", self._cost.conj(), multipliers, self._cost, optimize=True)
        root = np.linalg.inv(np.linalg.cholesky(A))
        gain = np.linalg.eigvalsh(root @ K @ root.conj().transpose(0, 2, 1))[:, -1]
        return np.asarray(gain * 2 * self.stage.sight.duration)


def _certified(
    solved: _Solved, fine: Sequence[_Fine], fixed: Array, objective: Objective
) -> tuple[float, list[Array]]:
    """Return the bound of the objective, and the frequencies at which more could be told.

    Of every design ``sum z_i s_i <= <Z, I> <= total``; under that, `_least` finds the best s.
    """
    Z = solved.duals.sum(axis=0)
    total = float(np.sum(Z * (fixed + sum(each.stage.known for each in fine))))
    more = []
    for each, mu in zip(fine, solved.multipliers, strict=True):
        mu = mu + 1e-6 * mu.max()  # what hardly has a price makes nothing free
        gain = each.dearest(Z, mu)
        total += float(gain.max() * mu.sum())
        inner = (gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:]) & (gain[1:-1] > 1 + TOLERANCE)
        more.append(each.frequency[1:-1][inner])
    of_wanted = solved.duals[np.arange(objective.wanted.size), objective.wanted, objective.wanted]
    return _least(of_wanted, total, objective), more


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


def _positive(matrix: Array) -> Array:
    """Return the nearest positive semidefinite matrix."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    return np.asarray((vectors * np.maximum(values, 0)) @ vectors.T)
