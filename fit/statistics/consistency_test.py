"""Test of whether runs agree on the parameters that they share.

chi^2 of a joint fit has some 100,000 degrees of freedom, in which a contradiction between runs is lost. The
sensitive statistic is T, the chisqr of the joint model of compressed runs (`fit.fitting.joint_model`): the
chi^2 of the joint fit less that of every run with coefficients of its own. Linearised about an estimate, the
residuals z of the runs in units of their noise obey

    z = noise - X (theta - estimate),

a linear regression with unit noise, of which T is the residual sum of squares. To leave out a run is to leave
out its rows; an effect of unknown size is one more column. The covariance of z allows for the window. The
uncertainty of the noise model scales the noise of z, so that T is distributed as F and not as chi^2.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import IRLSResult, run_estimate
from fit.statistics.run_scores import RunScore, run_score
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DETERMINED = 1e-3  # root of the information, in units of that of the weak prior, from which data determine


@dataclass(frozen=True)
class ChiSquare:
    """A sum of squares and what noise makes it.

    Attributes
    ----------
    value : float
        The sum.
    dof : int
        Its degrees of freedom.
    noise_dof : float
        Degrees of freedom of the noise model that it is measured by.
    """

    value: float
    dof: int
    noise_dof: float = np.inf

    @cached_property
    def p(self) -> float:
        """Probability that noise exceeds it; 1 without degrees of freedom."""
        if self.dof < 1:
            return 1.0
        if not np.isfinite(self.noise_dof):
            return float(scipy.special.chdtrc(self.dof, max(self.value, 0.0)))
        # the mean over noise models is right, see `NoiseModel.expected`
        ratio = max(self.value, 0.0) / self.dof * self.noise_dof / (self.noise_dof - 2)
        return float(scipy.special.fdtrc(self.dof, self.noise_dof, ratio))


@dataclass(frozen=True)
class ConsistencyTest:
    """The regression of the residuals of several runs on common parameters.

    Attributes
    ----------
    runs : tuple of RunScore
        The runs.
    width : ndarray, shape (P,)
        Natural scale of each parameter, the sigma of its weak prior.
    prior_rows : ndarray, shape (L, P)
        Prior knowledge, each row divided by its sigma.
    prior_residual : ndarray, shape (L,)
        Distance of the estimate from it in sigmas.
    """

    runs: tuple[RunScore, ...]
    width: Array
    prior_rows: Array
    prior_residual: Array

    @cached_property
    def rows(self) -> list[slice]:
        """Rows of each run; those of prior knowledge come last."""
        ends = np.cumsum([0, *(run.residual.size for run in self.runs)])
        return [slice(a, b) for a, b in pairwise(ends)]

    @cached_property
    def residual(self) -> Array:
        """Residuals of all runs and of prior knowledge, shape (N,)."""
        return np.concatenate([*(run.residual for run in self.runs), self.prior_residual])

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of `residual` by the parameters in their natural scales, shape (N, P)."""
        rows = [*(run.jacobian for run in self.runs), self.prior_rows]
        return np.asarray(np.concatenate(rows) * self.width)

    @cached_property
    def residual_maker(self) -> Array:
        """Projection on what the parameters cannot explain, shape (N, N)."""
        return self._projection(np.ones(self.residual.size, dtype=bool))

    @cached_property
    def total(self) -> ChiSquare:
        """T of all runs."""
        return self._chi_square(self.residual_maker)

    def without(self, numbers: Collection[int]) -> "ConsistencyTest":
        """Return the test without some of the runs."""
        return replace(self, runs=tuple(run for i, run in enumerate(self.runs) if i not in numbers))

    def of_runs(self, numbers: Sequence[int]) -> ChiSquare:
        """Return by how much T falls without some of the runs."""
        remaining = np.ones(self.residual.size, dtype=bool)
        for i in numbers:
            remaining[self.rows[i]] = False
        return self._chi_square(self.residual_maker - self._projection(remaining))

    def column(self, i: int, values: Array) -> Array:
        """Return an effect on one run only as a column, shape (N, 1)."""
        column = np.zeros((self.residual.size, 1))
        column[self.rows[i], 0] = values
        return column

    def covariance(self) -> Array:
        """Return the covariance of the parameters in their natural scales, shape (P, P).

        What the data do not determine has a variance beyond 1.
        """
        values, vectors = np.linalg.eigh(self.jacobian.T @ self.jacobian)
        return np.asarray((vectors / np.maximum(values, DETERMINED**2)) @ vectors.T)

    def step(self) -> Array:
        """Return the change from theta to the minimum of T, shape (P,), SI."""
        u, s, vt = np.linalg.svd(self.jacobian, full_matrices=False)
        determined = s > DETERMINED
        amplitudes = u[:, determined].T @ self.residual / s[determined]
        return np.asarray(-(vt[determined].T @ amplitudes) * self.width)

    def chi2_of_subsets(self, subsets: Flags) -> tuple[Array, NDArray[np.intp]]:
        """Return T and its degrees of freedom over subsets of the runs, (M, R), each of shape (M,)."""
        slices = [*self.rows, slice(self.rows[-1].stop, self.residual.size)]
        X = [self.jacobian[rows] for rows in slices]
        z = [self.residual[rows] for rows in slices]
        include = np.column_stack([subsets, np.ones(len(subsets))]).astype(float)
        H = np.tensordot(include, np.array([x.T @ x for x in X]), 1)
        score = include @ np.array([x.T @ y for x, y in zip(X, z, strict=True)])
        values, vectors = np.linalg.eigh(H)
        determined = values > DETERMINED**2
        explained = np.einsum("mij,mi->mj", vectors, score) ** 2 / np.where(determined, values, np.inf)
        chi2 = include @ np.array([y @ y for y in z]) - explained.sum(axis=1)
        dof = include @ np.array([y.size for y in z]) - determined.sum(axis=1)
        return chi2, np.rint(dof).astype(np.intp)

    def _projection(self, rows: Flags) -> Array:
        """Return the projection on what the parameters leave of some rows, shape (N, N)."""
        projection = np.diag(rows.astype(float))
        u, s, _ = np.linalg.svd(self.jacobian[rows], full_matrices=False)
        Q = np.zeros((self.residual.size, int(np.count_nonzero(s > DETERMINED))))
        Q[rows] = u[:, s > DETERMINED]
        return np.asarray(projection - Q @ Q.T)

    @cached_property
    def _noise_errors(self) -> tuple[NDArray[np.intp], scipy.sparse.csr_array]:
        """Where the blocks of the runs lie in a projection, and the effect of the noise models on them."""
        index = np.arange(self.residual.size**2).reshape(self.residual.size, self.residual.size)
        positions = np.concatenate([index[rows, rows].ravel() for rows in self.rows])
        errors = [
            whitened_run.matrix_sqrt(run.knot_covariance)
            @ run.knot_effects.reshape(len(run.knot_effects), run.residual.size**2)
            for run in self.runs
        ]
        return positions, scipy.sparse.csr_array(scipy.sparse.block_diag(errors))

    def _chi_square(self, projection: Array) -> ChiSquare:
        """Return the sum of squares in the range of a projection, shape (N, N)."""
        dof = float(np.trace(projection))
        positions, errors = self._noise_errors
        scaled = errors @ projection.ravel()[positions]
        variance = float(scaled @ scaled)
        noise_dof = 2 * dof**2 / variance + 4 if variance > 0 else np.inf
        return ChiSquare(float(self.residual @ projection @ self.residual), round(dof), noise_dof)


def consistency_test(
    experiments: Sequence[Experiment],
    joint: IRLSResult,
    whitened_runs: Sequence[whitened_run.WhitenedRun] | None = None,
) -> ConsistencyTest:
    """Return the test of experiments about the estimate of a joint fit.

    Weak priors hold what the data do not determine, which is no knowledge to contradict; deviations of runs
    (random effects) count with the width that was found for them.

    Parameters
    ----------
    experiments : sequence of Experiment
        In the joint fit or not.
    joint : IRLSResult
        The joint fit.
    whitened_runs : sequence of WhitenedRun, optional
        The whitened runs; by default those of the joint fit.
    """
    theta, parameters = joint.solution.theta, joint.parameters
    runs = tuple(
        run_score(e.name, block, run_estimate(e.name, block), theta)
        for e, block in zip(experiments, whitened_runs or joint.whitened_runs, strict=True)
    )
    widths = {
        i: joint.scatter[name][0]
        for effect in joint.random_effects
        for i in effect.members
        for name in joint.scatter
        if parameters[i].name.startswith(f"d{name}_")
    }
    means = np.array([p.value for p in parameters])
    for i, p in enumerate(joint.result.params.values()):
        if parameters[i].assumed_sigma and p.user_data:
            means[i], widths[i] = p.user_data
    rows = prior_rows(widths, theta.size)
    return ConsistencyTest(runs, np.array([p.prior_sigma for p in parameters]), rows, rows @ (theta - means))


def prior_rows(widths: Mapping[int, float], size: int) -> Array:
    """Return priors of single parameters, their sigmas given by place, as rows, shape (L, `size`)."""
    return np.asarray(np.eye(size)[list(widths)] / np.reshape(list(widths.values()), (-1, 1)))
