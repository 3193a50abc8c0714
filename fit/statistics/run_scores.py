"""The residual of one compressed run at the parameters of a joint fit, in the directions that are trusted."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import RunEstimate, column_scale, moments, score_whitening
from fit.whitening import whitened_run

Array = NDArray[np.float64]

MISMATCH = 1.5  # factor between noise and its model from which the model is no measure of the noise
NULL = 1e-5  # singular value relative to the largest, below which a direction is not determined
DRIVEN = 100.0  # whitened power of a bin, 2 for noise alone, from which an injection drives it
SIGNAL_SHARE = 0.5  # of the information on the loop that must come from driven bins


@dataclass(frozen=True)
class RunScore:
    """The trusted rows of one compressed run at the parameters of a joint fit.

    Attributes
    ----------
    estimate : RunEstimate
        The run, its rows restricted to those that are trusted (`trusted_rows`).
    equation : WhitenedRun
        From the P fitted parameters to the K coefficients of the run.
    theta : ndarray, shape (P,)
        The parameters.
    knot_effects : ndarray, shape (S, N, N)
        Derivatives of the covariance of the residual by the S knots of the noise model.
    knot_covariance : ndarray, shape (S, S)
        Covariance of the knots.
    noise_level : float
        Variance of the noise in units of its model; 1 where the model holds.
    """

    estimate: RunEstimate
    equation: whitened_run.WhitenedRun
    theta: Array
    knot_effects: Array
    knot_covariance: Array
    noise_level: float = 1.0

    @property
    def name(self) -> str:
        """Name of the experiment."""
        return self.estimate.name

    @cached_property
    def residual(self) -> Array:
        """By how much the run departs from theta in units of its noise, shape (N,)."""
        return self.estimate.residual(self.theta)

    @cached_property
    def run_jacobian(self) -> Array:
        """Derivatives of `residual` by the Q parameters of the run, shape (N, Q)."""
        return np.asarray(self.estimate.root @ self.equation.run_gradient(self.theta)[1:])

    @property
    def jacobian(self) -> Array:
        """Derivatives of `residual` by the fitted parameters, shape (N, P)."""
        return np.asarray(self.run_jacobian @ self.equation.parameter_map)

    @property
    def run_theta(self) -> Array:
        """Parameters of the run, shape (Q,)."""
        return np.asarray(self.equation.parameter_map @ self.theta)

    def single_fit(self) -> tuple[Array, Array]:
        """Return the parameters of the run by itself and their sigmas, each of shape (Q,).

        The sigma of what the run does not determine is infinite.
        """
        J = self.run_jacobian
        scale = 1 / np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        u, s, vt = np.linalg.svd(J * scale, full_matrices=False)
        rank = int(np.count_nonzero(s > NULL * s[0])) if s.size else 0
        step = -(vt[:rank].T @ ((u[:, :rank].T @ self.residual) / s[:rank])) * scale
        sigma = np.linalg.norm(vt[:rank].T / s[:rank], axis=1) * scale
        free = np.linalg.norm(vt[:rank], axis=0) < 1 - NULL
        return self.run_theta + step, np.where(free, np.inf, sigma)

    def derivative(self, name: str) -> Array:
        """Return the derivative by a parameter of the run, shape (N,); zero if the run has none of it."""
        names = self.equation.names
        if name not in names:
            return np.zeros_like(self.residual)
        return np.asarray(self.run_jacobian[:, names.index(name)])


def run_score(name: str, block: whitened_run.WhitenedRun, estimate: RunEstimate, theta: Array) -> RunScore:
    """Return the trusted rows of a run.

    Parameters
    ----------
    name : str
        Of the experiment.
    block : WhitenedRun
        The run; its share maps the fitted parameters to its own.
    estimate : RunEstimate
        The same, compressed.
    theta : ndarray, shape (P,)
        The fitted parameters, near the joint estimate.
    """
    H, M = moments(block)
    level = noise_level(block)
    W = trusted_rows(block, score_whitening(H, M * level), H)
    effects, covariance = _knots(block, W)
    equation = block.without_data()
    rows = RunEstimate(name, estimate.c, W @ H, equation)
    return RunScore(rows, equation, theta, effects, covariance, level)


def trusted_rows(block: whitened_run.WhitenedRun, W: Array, H: Array) -> Array:
    """Return the rows W, (R, K), of whitened scores in which a signal speaks, shape (N, K).

    Noisy read-outs attenuate the coefficients of spacecraft motion and torques, in every run differently. In
    closed loop commands and o_12 answer to the noise: what noise alone says of gain, delay and stiffness is
    only as good as its model. A direction of these is trusted where at least `SIGNAL_SHARE` of the
    information on it comes from driven bins; a run with a single tone has fewer such directions, one without
    injections none.
    """
    root = W @ H
    if tuple(block.names) == block.equation.parameters[: len(block.names)]:
        doubtful = np.hstack([_doubtful_directions(*part, root, H) for part in _system_parts(block)])
    else:  # a simulated loop, linear in the parameters of the run: those of read-outs come last
        doubtful = root[:, len(block.names) :]
    basis = column_space(of_unit_length(doubtful))
    if not basis.size:
        return W
    u, s, _ = np.linalg.svd(np.eye(len(W)) - basis @ basis.T)
    return np.asarray(u[:, s > 0.5].T @ W)


def _system_parts(block: whitened_run.WhitenedRun) -> list[tuple[whitened_run.WhitenedRun, NDArray[np.intp]]]:
    """Return the equations of a run, and the places of their coefficients among those of the run."""
    return [(part, places[1:] - 1) for part, places in zip(block.blocks, block.places, strict=True)]


def _doubtful_directions(
    block: whitened_run.WhitenedRun, places: NDArray[np.intp], root: Array, H: Array
) -> Array:
    """Return the whitened scores, as columns, of noisy regressors and of directions without a signal.

    Of an equation of a run whose coefficients have these places.
    """
    columns, equation = list(block.equation.columns), block.equation
    of_signal = [columns.index(name) for name in equation.driven_columns]
    signals = block.columns[:, of_signal] * block.free_coefficients[of_signal]
    driven = (np.abs(signals) ** 2 > DRIVEN).any(axis=1)
    loop = [columns.index(name) - 1 for name in equation.loop_columns]
    scale = column_scale(H)[places[loop]]
    U = (block.columns[:, 1:] * np.sqrt(block.weights.curvature)[:, None])[:, loop] * scale
    signal, every = ((x.conj().T @ x).real for x in (U[driven], U))
    present = scale > 0
    share, vectors = scipy.linalg.eigh(signal[np.ix_(present, present)], every[np.ix_(present, present)])
    directions = scale[present, None] * vectors[:, share < SIGNAL_SHARE]
    regressors = root[:, [places[columns.index(name) - 1] for name in equation.noisy_columns]]
    of_noise = root[:, places] @ block.noise_directions
    return np.hstack([root[:, places[np.array(loop)[present]]] @ directions, of_noise, regressors])


def noise_level(block: whitened_run.WhitenedRun) -> float:
    """Return the variance of the noise in units of its model, 1 where it is about that.

    A noise run that does not match is no contradiction among experiments.
    """
    if not np.array_equal(block.weights.fit, np.ones(len(block.columns))):
        return 1.0
    chi2 = float(np.sum((block.root_level @ block.free_coefficients) ** 2))
    level = chi2 / (block.size - block.free_coefficients.size + 1)
    return 1.0 if 1 / MISMATCH < level < MISMATCH else level


def _knots(block: whitened_run.WhitenedRun, W: Array) -> tuple[Array, Array]:
    """Return the derivatives of the covariance of whitened scores by the knots, and that of the knots."""
    effects, covariances = [np.zeros((0, len(W), len(W)))], []
    for part, places in _system_parts(block):
        if part.noise is None or part.f is None:
            continue
        basis = part.noise.basis(part.f)
        u = W[:, places] @ (part.columns[:, 1:] * np.sqrt(part.weights.fit)[:, None]).T
        a, b = u.real.copy(), u.imag.copy()  # contiguous
        of_part = np.empty((len(part.noise.knots), len(W), len(W)))
        for i in range(len(W)):
            of_part[:, i, i:] = of_part[:, i:, i] = basis.summed(a[i] * a[i:] + b[i] * b[i:]).T
        effects.append(of_part)
        covariances.append(part.noise.covariance)
    return np.concatenate(effects), scipy.linalg.block_diag(*covariances) if covariances else np.zeros((0, 0))


def of_unit_length(columns: Array) -> Array:
    """Return columns scaled to unit length; zero columns stay zero."""
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def column_space(columns: Array) -> Array:
    """Return an orthonormal basis of the range of columns of about unit length."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > NULL])
