"""Whether experiments agree: what each says by itself beside what all of them say together.

chi^2 of a joint fit does not tell. It has some 100,000 degrees of freedom, and a contradiction of thousands
of units drowns in them. What tells is T, the chi^2 of the joint fit less that of every experiment free in all
its coefficients. It has as many degrees of freedom as the experiments determine directions beyond those that
they share.

Everything follows from the compressed runs. At the joint estimate the score of a run, the gradient of its
cost by its coefficients, would be noise of known covariance if the run agreed; in the units of that noise it
is a vector z, and

    z = noise - X (theta - estimate),

a linear regression with unit noise. T is what it leaves. A run left out is rows left out; a fault is a column
more for the rows of one run. All that costs milliseconds. The window is in the covariance of the scores; the
error of the noise model makes the noise of z louder or quieter, hence the F distribution in the place of that
of chi^2, with as many degrees of freedom as the model has where the test looks.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.fitting import IRLSResult, score_whitening
from fit.model import dynamics
from fit.whitening import Experiment, whitened_run

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

OFF = 1.5  # factor between noise and its model from which one is no measure of the other
_NULL = 1e-10  # information relative to the largest, below which a run does not see a direction
LEVERAGE = 0.5  # share of a run in what the joint fit knows of a direction, up to which others tell it
HARMLESS = 1.0  # sigma by which what a run tells of a direction may move the joint fit
HELD = 1e-3  # root of the information, in units of the weak prior's, below which a direction counts as held


@dataclass(frozen=True)
class Squares:
    """A sum of squares beside what noise makes it.

    Attributes
    ----------
    value : float
        The sum.
    dof : int
        Its degrees of freedom: what noise makes it on average.
    of_noise : float
        Degrees of freedom of the noise model that it was measured by.
    """

    value: float
    dof: int
    of_noise: float = np.inf

    @cached_property
    def p(self) -> float:
        """How often noise exceeds it; 1 without degrees of freedom."""
        if self.dof < 1:
            return 1.0
        if not np.isfinite(self.of_noise):
            return float(scipy.special.chdtrc(self.dof, max(self.value, 0.0)))
        # the mean over noise models is right, see `NoiseModel.expected`
        ratio = max(self.value, 0.0) / self.dof * self.of_noise / (self.of_noise - 2)
        return float(scipy.special.fdtrc(self.dof, self.of_noise, ratio))


@dataclass(frozen=True)
class Voice:
    """What one run says about the parameters.

    Attributes
    ----------
    name : str
        Of the experiment.
    z : ndarray, shape (N,)
        Its score at the estimate in the units of its noise, in the directions that it determines.
    answer : ndarray, shape (N, K)
        By how much z falls with each of the K coefficients.
    gradient : ndarray, shape (K, Q)
        Derivatives of the coefficients by the Q parameters of the run.
    share : ndarray, shape (Q, P)
        Map from the P fitted parameters to those of the run.
    theta : ndarray, shape (Q,)
        Parameters of the run at the estimate.
    tau : tuple of float
        Delays [s] about which the columns are expanded.
    knots : ndarray, shape (S, N, N)
        How every knot of the noise model adds to the covariance of z.
    of_knots : ndarray, shape (S, S)
        Covariance of the knots.
    level : float
        How much louder than its model the noise was taken to be: 1 where the model holds.
    names : sequence of str
        The first of the parameters of the run.
    """

    name: str
    z: Array
    answer: Array
    gradient: Array
    share: Array
    theta: Array
    tau: tuple[float, float]
    knots: Array
    of_knots: Array
    level: float = 1.0
    names: Sequence[str] = dynamics.PARAMETERS

    @property
    def X(self) -> Array:
        """By how much z falls with each of the fitted parameters, shape (N, P)."""
        return np.asarray(self.answer @ self.gradient @ self.share)

    def alone(self) -> tuple[Array, Array]:
        """Return the parameters of the run as it alone has them, and their sigmas, each of shape (Q,).

        The sigma of what it does not determine is infinite.
        """
        slope = self.answer @ self.gradient
        scale = 1 / np.maximum(np.linalg.norm(slope, axis=0), 1e-300)
        u, s, vt = np.linalg.svd(slope * scale, full_matrices=False)
        seen = s > _NULL**0.5 * s[0]
        step = -(vt[seen].T @ ((u[:, seen].T @ self.z) / s[seen])) * scale
        sigma = np.linalg.norm(vt[seen].T / s[seen], axis=1) * scale
        free = np.linalg.norm(vt[seen], axis=0) < 1 - _NULL**0.5
        return self.theta + step, np.where(free, np.inf, sigma)

    def along(self, name: str) -> Array:
        """By how much z falls with one of the run's own parameters, shape (N,); not at all if it has none."""
        if name not in self.names:
            return np.zeros_like(self.z)
        return np.asarray(self.answer @ self.gradient[:, self.names.index(name)])


def voice(
    experiment: Experiment, block: whitened_run.WhitenedRun, theta: Array, covariance: Array | None = None
) -> Voice:
    """Return what a run says.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    block : whitened_run.WhitenedRun
        Weighed.
    theta : ndarray, shape (P,)
        Where to begin, near the estimate of P parameters.
    covariance : ndarray, shape (P, P), optional
        Of the joint fit: what is in doubt is heard where it weighs there.
    """
    of_run = block.share @ theta
    R, H, c = block.R, block.H, block.coefficients(theta)
    score = R.T[1:] @ (R @ c)
    gradient, level = block.of_run(theta), _level(block, c)
    W = score_whitening(H[1:, 1:], block.M[1:, 1:] * level)
    spread = None if covariance is None else block.share @ whitened_run.rooted(covariance).T
    W = _believed(block, of_run, W @ score, W @ H[1:] @ gradient, spread) @ W
    knots, of_knots = _knots(block, W)
    return Voice(
        name=experiment.name,
        z=W @ score,
        answer=W @ H[1:],
        gradient=gradient,
        share=block.share,
        theta=of_run,
        tau=block.tau,
        knots=knots,
        of_knots=of_knots,
        names=block.names,
        level=level,
    )


def _believed(
    block: whitened_run.WhitenedRun, of_run: Array, z: Array, slope: Array, spread: Array | None
) -> Array:
    """Return the directions of z, shape (L, N), in which a signal speaks and not noise in the regressors.

    What motion and torques add is left out: noise in its read-outs attenuates it, in every run differently.
    No signal at all tells neither gain nor stiffness, a single tone does not tell one from the other: see
    `fit.whitening.single_tone`. The rest of a run with a tone is left out too, unless the joint fit
    leans on it.

    `slope`, shape (N, Q), is what the parameters of the run do to z; `spread`, shape (Q, P), a root of their
    covariance in the joint fit.
    """
    at = {name: i for i, name in enumerate(dynamics.PARAMETERS)}
    doubted, told = slope[:, len(block.names) :], np.zeros((len(slope), 0))
    if block.tone is not None:
        stiffness, gain, delay = (slope[:, at[name]] for name in ("omega2_2", "lambda_2", "C_2"))
    if block.tone:  # at its frequency nothing changes if the gain follows the stiffness
        omega2_2, lambda_2 = of_run[at["omega2_2"]], of_run[at["lambda_2"]]
        per_stiffness = lambda_2 / (omega2_2 - (2 * np.pi * block.tone) ** 2)
        told = (stiffness + per_stiffness * gain)[:, None]
    elif block.tone == 0:
        doubted = np.column_stack([doubted, stiffness, gain, delay])
    doubted, told = _range(_of_unit_length(doubted)), _of_unit_length(told)
    Q = _range(told - doubted @ (doubted.T @ told))
    if spread is not None:
        weight = np.linalg.norm(Q.T @ slope @ spread, axis=1) ** 2
        Q = Q[:, (weight * (Q.T @ z) ** 2 < HARMLESS**2) | (weight > LEVERAGE)]
    blind = np.hstack([doubted, Q])
    if not blind.size:
        return np.eye(len(slope))
    u, s, _ = np.linalg.svd(np.eye(len(slope)) - blind @ blind.T)
    return np.asarray(u[:, s > 0.5].T)


def _level(block: whitened_run.WhitenedRun, c: Array) -> float:
    """Return how much louder the noise is than its model, 1 where it is about that loud.

    A noise run that does not match is no contradiction among experiments.
    """
    if not np.array_equal(block.weights.fit, np.ones(len(block.columns))):
        return 1.0
    left = block.R @ c
    free = np.linalg.lstsq(block.R[:, 1:], left)[0]
    level = float(np.sum((left - block.R[:, 1:] @ free) ** 2)) / (block.size - free.size)
    return 1.0 if 1 / OFF < level < OFF else level


def _knots(block: whitened_run.WhitenedRun, W: Array) -> tuple[Array, Array]:
    """Return by how much each knot of the noise model adds to the covariance of z, and theirs."""
    if block.noise is None or block.f is None:
        return np.zeros((0, len(W), len(W))), np.zeros((0, 0))
    basis = block.noise.basis(block.f)
    u = W @ (block.columns[:, 1:] * np.sqrt(block.weights.fit)[:, None]).T
    a, b = u.real.copy(), u.imag.copy()  # in one piece each
    found = np.empty((len(block.noise.knots), len(W), len(W)))
    for i in range(len(W)):
        found[:, i, i:] = found[:, i:, i] = basis.summed(a[i] * a[i:] + b[i] * b[i:]).T
    return found, block.noise.covariance


@dataclass(frozen=True)
class Regression:
    """The voices of several runs on common parameters.

    Attributes
    ----------
    voices : tuple of Voice
        Of the runs.
    width : ndarray, shape (P,)
        Natural scale of each parameter.
    known : ndarray, shape (L, P)
        Rows of what is known beside the data, divided by its sigma.
    off : ndarray, shape (L,)
        How far the estimate is from that, in sigmas.
    """

    voices: tuple[Voice, ...]
    width: Array
    known: Array
    off: Array

    @cached_property
    def rows(self) -> list[slice]:
        """Which rows belong to which run; those of what is known come last."""
        ends = np.cumsum([0, *(v.z.size for v in self.voices)])
        return [slice(a, b) for a, b in pairwise(ends)]

    @cached_property
    def z(self) -> Array:
        """All that was measured, shape (N,)."""
        return np.concatenate([*(v.z for v in self.voices), self.off])

    @cached_property
    def X(self) -> Array:
        """What the parameters do to it, in their natural scales, shape (N, P)."""
        return np.asarray(np.concatenate([*(v.X for v in self.voices), self.known]) * self.width)

    @cached_property
    def residual_maker(self) -> Array:
        """Projection on what the parameters cannot explain, shape (N, N)."""
        return self._beyond(np.ones(self.z.size, dtype=bool))

    @cached_property
    def whole(self) -> Squares:
        """T, over all runs."""
        return self._test(self.residual_maker)

    def without(self, left_out: Iterable[int]) -> "Regression":
        """Return the regression without some of the runs, by number."""
        gone = set(left_out)
        return replace(self, voices=tuple(v for i, v in enumerate(self.voices) if i not in gone))

    def of_run(self, i: int) -> Squares:
        """Return by how much T falls without a run."""
        kept = np.ones(self.z.size, dtype=bool)
        kept[self.rows[i]] = False
        return self._test(self.residual_maker - self._beyond(kept))

    def of_columns(self, columns: Array) -> Squares:
        """Return by how much T falls with more columns, shape (N, Q)."""
        left = self.residual_maker @ columns
        Q = _range(left / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
        return self._test(Q @ Q.T)

    def column(self, i: int, of_run: Array) -> Array:
        """Return a column, shape (N, 1), that is of one run only."""
        found = np.zeros((self.z.size, 1))
        found[self.rows[i], 0] = of_run
        return found

    def amount(self, column: Array) -> tuple[float, float]:
        """Return how much of a column, shape (N, 1), is in the data, and its sigma."""
        left = self.residual_maker @ column[:, 0]
        power = float(left @ left)
        if power <= (_NULL * np.linalg.norm(column)) ** 2:
            return 0.0, np.inf
        return -float(left @ self.z) / power, power**-0.5

    def covariance(self) -> Array:
        """Return the covariance of the parameters in their natural scales, shape (P, P).

        What the data do not determine has a variance beyond 1.
        """
        values, vectors = np.linalg.eigh(self.X.T @ self.X)
        return np.asarray((vectors / np.maximum(values, HELD**2)) @ vectors.T)

    def estimate(self) -> Array:
        """Return by how much the parameters differ from where the voices were taken, shape (P,), SI."""
        u, s, vt = np.linalg.svd(self.X, full_matrices=False)
        seen = s > HELD
        return np.asarray(-(vt[seen].T @ ((u[:, seen].T @ self.z) / s[seen])) * self.width)

    def _beyond(self, kept: Flags) -> Array:
        """Return the projection on what the parameters leave of some rows, shape (N, N)."""
        found = np.diag(kept.astype(float))
        u, s, _ = np.linalg.svd(self.X[kept], full_matrices=False)
        Q = np.zeros((self.z.size, int(np.count_nonzero(s > HELD))))
        Q[kept] = u[:, s > HELD]
        return np.asarray(found - Q @ Q.T)

    @cached_property
    def _doubt(self) -> tuple[NDArray[np.intp], scipy.sparse.csr_array]:
        """Where the blocks of runs are in a projection; what errors of the noise models make of these."""
        at = np.arange(self.z.size**2).reshape(self.z.size, -1)
        where = np.concatenate([at[rows, rows].ravel() for rows in self.rows])
        blocks = [whitened_run.rooted(v.of_knots) @ v.knots.reshape(-1, v.z.size**2) for v in self.voices]
        return where, scipy.sparse.csr_array(scipy.sparse.block_diag(blocks))

    def _test(self, projection: Array) -> Squares:
        """Return the sum of squares in the range of a projection, shape (N, N)."""
        dof = float(np.trace(projection))
        where, doubt = self._doubt
        louder = doubt @ projection.ravel()[where]
        squared = float(louder @ louder)
        of_noise = 2 * dof**2 / squared + 4 if squared > 0 else np.inf
        return Squares(float(self.z @ projection @ self.z), round(dof), of_noise)


def _of_unit_length(columns: Array) -> Array:
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def _range(columns: Array) -> Array:
    """Return an orthonormal basis of the range of columns of about unit length."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > _NULL**0.5])


def regression(experiments: Sequence[Experiment], outcome: IRLSResult) -> Regression:
    """Return what the experiments of a joint fit say, about its estimate."""
    return voiced(experiments, outcome.blocks, outcome)


def voiced(
    experiments: Sequence[Experiment], blocks: Sequence[whitened_run.WhitenedRun], outcome: IRLSResult
) -> Regression:
    """Return what experiments say, in the joint fit or not, about its estimate.

    Weak priors hold what the data do not tell, which is no knowledge to contradict; departures of experiments
    (`departures`) count with the width that was found for them.
    """
    theta, covariance, parameters = outcome.solution.theta, outcome.solution.covariance, outcome.parameters
    voices = tuple(voice(e, b, theta, covariance) for e, b in zip(experiments, blocks, strict=True))
    departs = {
        i: outcome.scatter[name][0]
        for width in outcome.departing
        for i in width.members
        for name in outcome.scatter
        if parameters[i].name.startswith(f"d{name}_")
    }
    known = np.zeros((len(departs), theta.size))
    for row, (i, spread) in enumerate(departs.items()):
        known[row, i] = 1 / spread
    return Regression(voices, np.array([p.prior_sigma for p in parameters]), known, known @ theta)
