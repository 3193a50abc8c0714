"""Coefficients that change within runs, slowly or at once: gains, delays and stiffness are constant in a fit.

A coefficient that follows the temperature, drifts or jumps leaves its column in the residual, times its
course. The test is that of a wave of some period: the driven part d of a whitened column, times sine and
cosine, with the residual r of the fit and what is refitted projected out,

    chi^2 = G' A^-1 G ,    G = (d cos, d sin)' r ,    A = (d cos, d sin)' P (d cos, d sin) .

A slope and a step are waves as well, of about twice the run. Runs need not agree on the phase, so that the
chi^2 of several runs has two degrees of freedom for each of them. Gains and delays that all runs share are
refitted in every run, which leaves their scatter between runs out of the test; all else is refitted jointly.

Only bins that some column drives count: elsewhere the commands answer the noise. Waves are slow, so that
whitening and multiplication commute, and sums over products of series are those of blocks of `BLOCK`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError
from fit.false_alarms import p_limit
from fit.fitting import IRLSResult
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.quality.exclusions import Exclusion
from fit.settings import Settings
from fit.spectra import windowing
from fit.warnings import Cause, FitWarning
from fit.whitening import Experiment, WhitenedRun, whitened_run

Array = NDArray[np.float64]

DRIFT = "drift"  # code of the warning
DRIVEN = 10.0  # amplitude of the term of a column, in units of the noise, from which a bin is driven
BLOCK = 300.0  # s
SHORTEST = 7200.0  # s, period: injections last as long
INDEPENDENT = 3e-3  # share of a wave that refitted columns must leave
RANK = 1e-9  # of an information matrix
REMAINING = 1e-2  # probability below which a drift of the equation shows without any one run too
NOISY = frozenset(dynamics.CROSS_TALK)  # columns with the read-out noise of the spacecraft's motion
WIDESPREAD, MIN_RUNS = 1 / 3, 3  # share of the runs, and number, from which a drift is one of the equation


@dataclass(frozen=True)
class Drift:
    """A coefficient that changes.

    Attributes
    ----------
    column : str
        Which it multiplies.
    period : float
        Of the wave that fits best [s].
    amplitude : float
        Its size over the coefficient, root mean square of the runs; infinite for a coefficient of zero.
    chi2, dof : float, int
        By how much chi^2 falls, for how many degrees of freedom.
    """

    column: str
    period: float
    amplitude: float
    chi2: float
    dof: int

    @property
    def p(self) -> float:
        """The probability that noise does that."""
        return float(scipy.special.chdtrc(self.dof, self.chi2))

    @property
    def words(self) -> str:
        """What changes, how fast and by how much."""
        size = f" by {100 * self.amplitude:.2g} %" if self.amplitude < 1 else ""
        return (
            f"the coefficient of {self.column} changes{size} within the run, as a drift or a wave of "
            f"{self.period / 3600:.2g} h does (chi2 = {self.chi2:.4g} for {self.dof} degrees of freedom)"
        )


@dataclass(frozen=True)
class BlockSums:
    """Products of the series of a whitened run, summed over blocks.

    Attributes
    ----------
    time : ndarray, shape (G,)
        Of the blocks, from the middle of the run [s].
    duration : float
        Of the run [s].
    coefficients : mapping of str to float
        By column.
    columns : mapping of str to tuple of ndarray
        By column, products of its driven part with the residual, shape (G,), with itself, (G,), with what is
        refitted in the run, (G, Q), and with what is refitted jointly, (G, P).
    information, score : ndarray, shapes (P, P) and (P,)
        Of what is refitted jointly.
    scale : ndarray, shape (P,)
        Sizes of its columns before what is refitted in the run is projected out.
    """

    time: Array
    duration: float
    coefficients: Mapping[str, float]
    columns: Mapping[str, tuple[Array, Array, Array, Array]]
    information: Array
    score: Array
    scale: Array


def block_sums(run: WhitenedRun, theta: Array, free: Collection[str] | None = None) -> BlockSums:
    """Return the sums of a whitened run, with a window, at theta, shape (P,).

    Parameters
    ----------
    run : WhitenedRun
        In one equation.
    theta : ndarray, shape (P,)
        Estimate of a fit.
    free : collection of str, optional
        Parameters of the run that are refitted in it, by default all of them.
    """
    assert run.window is not None and run.f is not None
    c, names = run.coefficients(theta), run.equation.columns
    U = run.columns * np.sqrt(run.weights.fit)[:, None]
    of_columns = np.abs(U * c) > DRIVEN
    if run.noise:  # below its knots the PSD is an extrapolation
        of_columns &= (np.log(run.f) > run.noise.knots[0] - 1e-9)[:, None]
    driven = np.any(of_columns, axis=1)
    # the delay of a command multiplies its slope
    moving = {name for name, bins in zip(names, of_columns.T, strict=True) if bins.any()}
    present = [
        k
        for k, name in enumerate(names)
        if {name, name.removeprefix("d")} & moving and name not in NOISY  # whose noise passes for a change
    ]
    excess = float(np.mean(np.abs(U @ c) ** 2)) / 2
    U = U / np.sqrt(windowing.variance_factor(run.window) * max(1.0, excess))
    own = [free is None or name in free for name in run.equation.parameters]
    basis = _orthonormal(whitened_run.as_real(U @ run.run_gradient(theta)[:, own]))
    joint, residual = whitened_run.as_real(U @ run.gradient(theta)), whitened_run.as_real((U @ c)[:, None])
    scale = np.linalg.norm(joint, axis=0)
    joint, residual = (x - basis @ (basis.T @ x) for x in (joint, residual))
    shared = np.flatnonzero(np.linalg.norm(joint, axis=0) > RANK * np.maximum(scale, 1e-300))
    numbers = np.cumsum([1, basis.shape[1], shared.size])
    parts = [_as_complex(x) for x in (residual, basis, joint[:, shared])]
    series, duration = _series(run, np.hstack([*parts, np.where(driven[:, None], U[:, present], 0)]))
    r, Q, joint_series, D = np.split(series, numbers, axis=1)
    size = max(1, round(BLOCK * len(series) / duration))

    def sums(x: Array) -> Array:
        return np.add.reduceat(x, np.arange(0, len(x), size), axis=0)

    columns = {}
    for k, d in zip(present, D.T[:, :, None], strict=True):
        of_joint = np.zeros((-(-len(d) // size), theta.size))
        of_joint[:, shared] = sums(d * joint_series)
        columns[names[k]] = sums(d * r)[:, 0], sums(d * d)[:, 0], sums(d * Q), of_joint
    n_blocks = -(-len(series) // size)
    time = (np.arange(n_blocks) + 0.5) * size * duration / len(series) - duration / 2
    coefficients = dict(zip(names, c.tolist(), strict=True))
    score = joint.T @ residual[:, 0]
    return BlockSums(time, duration, coefficients, columns, joint.T @ joint, score, scale)


def _orthonormal(columns: Array) -> Array:
    norms = np.linalg.norm(columns, axis=0)
    return np.asarray(np.linalg.qr(columns[:, norms > 0] / norms[norms > 0])[0])


def _as_complex(x: Array) -> NDArray[np.complex128]:
    """Return bins from their real and imaginary parts in turn, shape (B, ...)."""
    return np.ascontiguousarray(x.T).view(np.complex128).T


def _series(run: WhitenedRun, columns: NDArray[np.complex128]) -> tuple[Array, float]:
    """Return columns as series, whose products sum up to those of the bins, and the duration [s]."""
    assert run.window is not None and run.f is not None
    n = run.window.size
    m = min(scipy.fft.next_fast_len(4 * (run.first_bin + len(columns)), real=True), n)
    return windowing.inverse_transform(columns, run.first_bin, m) * np.sqrt(m / 2), run.first_bin / run.f[0]


def find_drift(runs: Sequence[BlockSums], limit: float) -> Drift | None:
    """Return the coefficient that changes most clearly within runs, None if none does.

    Parameters
    ----------
    runs : sequence of BlockSums
        Of one fit.
    limit : float
        Probability of a false alarm.
    """
    step, covariance = _joint(runs)
    n_periods = max(1, int(2 * max((run.duration for run in runs), default=0.0) / SHORTEST))
    columns = dict.fromkeys(name for run in runs for name in run.columns)
    drifts = (
        drift
        for name in columns
        for n in range(1, n_periods + 1)
        if (drift := _wave(runs, name, n_periods * SHORTEST / n, step, covariance))
    )
    best = min(drifts, key=lambda drift: (drift.p, -drift.chi2), default=None)
    return best if best and best.p * n_periods * len(columns) < limit else None


def _joint(runs: Sequence[BlockSums]) -> tuple[Array, Array]:
    """Return step and covariance of the parameters that are refitted jointly, shapes (P,) and (P, P)."""
    scale = np.sqrt(sum(run.scale**2 for run in runs))
    scale = np.where(scale > 0, scale, 1.0)
    information = sum(run.information for run in runs) / np.outer(scale, scale)
    covariance = np.linalg.pinv(information, RANK, hermitian=True) / np.outer(scale, scale)
    return covariance @ sum(run.score for run in runs), covariance


def _wave(
    runs: Sequence[BlockSums], name: str, period: float, step: Array, covariance: Array
) -> Drift | None:
    """Return the wave of a coefficient, None where what is refitted leaves nothing of it."""
    scores, squares, joint, coefficients = [], [], [], []
    for run in (run for run in runs if name in run.columns):
        r, dd, own, of_joint = run.columns[name]
        phase = 2 * np.pi * run.time / period
        waves = np.stack([np.cos(phase), np.sin(phase)])
        own, of_joint = waves @ own, waves @ of_joint
        scores.append(waves @ r - of_joint @ step)
        squares.append((waves * dd @ waves.T, own @ own.T))
        joint.append(of_joint)
        coefficients.append(run.coefficients[name])
    raw = np.concatenate([np.diag(whole) for whole, _ in squares])
    if not np.all(raw > 0):
        return None
    J, unit = np.concatenate(joint), 1 / np.sqrt(raw)
    A = scipy.linalg.block_diag(*(whole - projected for whole, projected in squares)) - J @ covariance @ J.T
    values, vectors = np.linalg.eigh(A * np.outer(unit, unit))
    left = values > INDEPENDENT
    if not left.any():
        return None
    z = (vectors.T @ (np.concatenate(scores) * unit))[left]
    amounts = vectors[:, left] @ (z / values[left]) * unit
    sizes = np.hypot(*amounts.reshape(-1, 2).T) / np.maximum(np.abs(coefficients), 1e-300)
    chi2 = float(np.sum(z**2 / values[left]))
    return Drift(name, period, float(np.sqrt(np.mean(sizes**2))), chi2, int(np.count_nonzero(left)))


def exclusions(
    experiments: Sequence[Experiment], fits: Mapping[str, IRLSResult | FitError]
) -> tuple[list[Exclusion], list[FitWarning]]:
    """Return the experiments of which a coefficient changes by their own fits, or a warning that many do.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those that may take part in a joint fit.
    fits : mapping of str to IRLSResult or FitError
        The fit of each by itself.
    """
    n = len(experiments)

    def find(e: Experiment) -> Drift | None:
        fit = fits[e.name]
        if isinstance(fit, FitError):
            return None
        blocks = _blocks(fit)
        sums = [[block_sums(block, fit.solution.theta)] for block in blocks]
        found = [find_drift(one, p_limit("drift in a run", n * len(blocks))) for one in sums]
        return min(filter(None, found), key=lambda drift: (drift.p, -drift.chi2), default=None)

    drifts = zip(experiments, parallel_map(find, experiments, Experiment.samples), strict=True)
    causes = [
        Cause(
            e.name, drift.column, DRIFT, drift.amplitude, words=drift.words, file=str(e.sysid.telemetry.path)
        )
        for e, drift in drifts
        if drift
    ]
    if causes and len(causes) >= max(min(MIN_RUNS, n), WIDESPREAD * n):
        return [], [_warning("; ".join(cause.sentence for cause in causes), causes)]
    return [Exclusion(cause.run, (cause,), evidence="cause") for cause in causes], []


def of_joint(fit: IRLSResult, settings: Settings) -> list[FitWarning]:
    """Return the warning of a coefficient that changes within the runs of a joint fit.

    Parameters
    ----------
    fit : IRLSResult
        The joint fit.
    settings : Settings
        Of the fit; what all runs share may scatter.
    """
    free = [name for name, group in settings.shared.items() if group == "campaign"]
    blocks = _blocks(fit)
    of_equation: dict[str, list[WhitenedRun]] = {}
    for block in blocks:
        of_equation.setdefault(block.equation.name, []).append(block)
    limit = p_limit("drift in all runs", len(of_equation))
    found = []
    for runs in of_equation.values():
        sums = [block_sums(run, fit.solution.theta, free) for run in runs]
        drift = find_drift(sums, limit)
        # what one run alone shows, such as the rest of a glitch, is none of the equation
        others = [[*sums[:i], *sums[i + 1 :]] for i in range(len(sums))] if len(sums) > 1 else []
        if drift and all(find_drift(rest, REMAINING) for rest in others):
            found.append(drift)
    return [_warning(f"in {len(fit.whitened_runs)} runs together {drift.words}") for drift in found]


def _blocks(fit: IRLSResult) -> list[WhitenedRun]:
    """Return the runs of a fit in each of their equations, as far as they have a PSD and a window."""
    blocks = [block for run in fit.whitened_runs for block in run.blocks]
    return [block for block in blocks if block.window is not None and block.f is not None]


def _warning(words: str, causes: Sequence[Cause] = ()) -> FitWarning:
    """Return the warning that coefficients change within runs."""
    message = f"{words}; the equation has constant coefficients, and the uncertainties are not valid"
    return FitWarning(DRIFT, (), message, causes=tuple(causes))
