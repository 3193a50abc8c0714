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
from lpfcosim.experiment_design.designed_experiment import DesignedExperiment
from lpfcosim.experiment_design.objective import Objective

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class TimeBudget:
    """Time that the experiments share.

    Attributes
    ----------
    total : float
        Of all [s].
    min_durations : ndarray, shape (n,)
        Of each stage [s].
    """

    total: float
    min_durations: Array


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
class ProgrammeSolution:
    """What the solver found: `duals` are those of ``I - s_i e_i e_i^T``, shape (W, P, P)."""

    information: Array
    powers: tuple[Complex, ...]
    durations: Array
    multipliers: tuple[Array, ...]
    duals: Array


def _basis(size: int) -> Complex:
    """Return a real basis of Hermitian matrices, shape (size^2, size, size)."""
    matrices = []
    for i, j in combinations_with_replacement(range(size), 2):
        for unit in (1.0,) if i == j else (1.0, 1j):
            matrix = np.zeros((size, size), dtype=np.complex128)
            matrix[i, j], matrix[j, i] = unit, np.conj(unit)
            matrices.append(matrix)
    return np.array(matrices)


def whiten(experiment: DesignedExperiment, frequency: Array) -> tuple[Complex, Complex, Complex]:
    """Return sensitivities and costs of tones, in units in which they cost about one, and these units."""
    sensitivity, cost = experiment.responses(frequency)
    total = np.einsum("nyi,nyj->nij", cost.conj(), cost)
    units = np.asarray(np.linalg.inv(np.linalg.cholesky(total)).conj().transpose(0, 2, 1), np.complex128)
    return sensitivity @ units, cost @ units, units


class _ConvexProgram:
    """The convex programme on grids of frequencies; `transform` combines parameters."""

    def __init__(
        self,
        experiments: Sequence[DesignedExperiment],
        responses: Sequence[tuple[Complex, Complex, Complex]],
        prior_information: Array,
        objective: Objective,
        budget: TimeBudget | None,
        transform: Array,
    ) -> None:
        self._cp = cp = solver()
        self._objective = objective
        self._experiments = experiments
        P = len(prior_information)
        self._transform = transform
        total: Any = transform @ prior_information @ transform.T
        self._constraints: list[Any] = []
        durations = np.array([experiment.model.duration for experiment in experiments])
        self._times = times = (
            cp.Variable(len(experiments)) if budget else np.ones(len(experiments))
        )  # of those planned
        if budget:
            self._constraints += [
                times >= budget.min_durations / durations,
                durations @ times / budget.total <= 1,
            ]
        self._limits: list[Any] = []
        self._powers: list[tuple[Any, Complex, Complex]] = []
        for n, (experiment, (sensitivity, cost, units)) in enumerate(
            zip(experiments, responses, strict=True)
        ):
            sensitivity = transform @ sensitivity
            total = total + (transform @ experiment.base_information @ transform.T) * times[n]
            basis = _basis(sensitivity.shape[2])
            x = cp.Variable((len(sensitivity), len(basis)))
            flat = cp.reshape(x, (x.size,), order="C")
            information = np.einsum(
                "npi,bij,nqj->pqnb", sensitivity.conj(), basis, sensitivity, optimize=True
            ).real
            information = information.reshape(P * P, -1) * 2 * experiment.model.duration
            total = total + cp.reshape(information @ flat, (P, P), order="C")
            spent = np.einsum("nyi,bij,nyj->ynb", cost.conj(), basis, cost, optimize=True).real
            self._limits.append(spent.reshape(len(experiment.active_limits), -1) @ flat <= times[n])
            self._constraints += [self._limits[-1], *_semidefinite(cp, x, basis)]
            self._powers.append((x, basis, units))
        self._information = cp.Variable((P, P), symmetric=True)
        self._constraints.append(self._information == total)

    def solve(self) -> ProgrammeSolution:
        """Solve it.

        Raises
        ------
        InputError
            If no design is as good as asked.
        RunError
            If the solver fails.
        """
        cp, objective = self._cp, self._objective
        corners = self._transform[:, objective.indices].T
        size = np.sum(corners**2, axis=1)  # over this s is of the order of one
        s = cp.Variable(objective.indices.size)
        margins = [
            self._information - s[k] * np.outer(row, row) / size[k] >> 0 for k, row in enumerate(corners)
        ]
        goal = cp.min(cp.multiply(s, 1 / size)) if objective.minimax else objective.weights @ cp.log(s)
        bounded = s >= size / objective.max_ratios**2
        problem = cp.Problem(cp.Maximize(goal), [*self._constraints, *margins, bounded])
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
        back = np.linalg.inv(self._transform)
        times = np.asarray(getattr(self._times, "value", self._times))
        return ProgrammeSolution(
            information=np.asarray(back @ self._information.value @ back.T),
            powers=tuple(
                _power(x.value / t, basis, units)
                for t, (x, basis, units) in zip(times, self._powers, strict=True)
            ),
            durations=times * [experiment.model.duration for experiment in self._experiments],
            multipliers=tuple(np.maximum(np.atleast_1d(limit.dual_value), 0) for limit in self._limits),
            duals=np.array(
                [self._transform.T @ _positive(np.asarray(p.dual_value)) @ self._transform for p in margins]
            ),
        )


def solve_program(
    experiments: Sequence[DesignedExperiment],
    grids: Sequence[Array],
    prior_information: Array,
    objective: Objective,
    budget: TimeBudget | None,
    reference_information: Array | None = None,
) -> ProgrammeSolution:
    """Solve the programme.

    Parameters may be correlated to five digits, at which a solver loses its own. It is given combinations of
    them with equal information: by `reference_information` of a solution, if one is known, or by
    an even spread of power. Only where no solution is found otherwise are parameters as they are.

    Raises
    ------
    InputError
        If no design is as good as asked.
    RunError
        If the solver fails.
    """
    responses = [whiten(experiment, grid) for experiment, grid in zip(experiments, grids, strict=True)]
    transforms = [
        _preconditioner(_even_information(experiments, responses, prior_information)),
        np.eye(len(prior_information)),
    ]
    if reference_information is not None:
        transforms.insert(0, _preconditioner(reference_information))
    for transform in transforms[:-1]:
        with suppress(RunError):
            return _ConvexProgram(
                experiments, responses, prior_information, objective, budget, transform
            ).solve()
    return _ConvexProgram(
        experiments, responses, prior_information, objective, budget, transforms[-1]
    ).solve()


def _preconditioner(information: Array) -> Array:
    """Return combinations of parameters of which this information is the identity, shape (P, P)."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(information)))


def _even_information(
    experiments: Sequence[DesignedExperiment],
    responses: Sequence[tuple[Complex, Complex, Complex]],
    prior_information: Array,
) -> Array:
    """Return the information of an even spread of power, shape (P, P)."""
    total = prior_information + sum(experiment.base_information for experiment in experiments)
    for experiment, (sensitivity, _, _) in zip(experiments, responses, strict=True):
        n, _, loops = sensitivity.shape
        total += (
            np.einsum("npl,nql->pq", sensitivity.conj(), sensitivity).real
            * 2
            * experiment.model.duration
            / (n * loops)
        )
    return np.asarray(total)


def _semidefinite(cp: Any, x: Any, basis: Complex) -> list[Any]:
    """Return the constraints that make powers out of coefficients of a basis."""
    size = basis.shape[1]
    if size == 1:
        return [x >= 0]
    if size == 2:  # a cone of second order is all that it takes
        diagonal_1, real, imaginary, diagonal_2 = x[:, 0], x[:, 1], x[:, 2], x[:, 3]
        return [
            cp.SOC(
                diagonal_1 + diagonal_2, cp.vstack([2 * real, 2 * imaginary, diagonal_1 - diagonal_2]), axis=0
            )
        ]
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
