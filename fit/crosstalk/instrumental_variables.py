"""Unbiased couplings from noisy read-outs: b_3 to b_6 by instruments (Eq. (3)).

The capacitive y and z carry as much noise n as motion at the end of the band, so that least squares finds
b_3 to b_6 too small. The two test masses read the same motion with noises of their own. In the mean of
their read-outs, c = y + m with m = (n_1 + n_2) / 2, the power S_m of m is that of d = (n_2 - n_1) / 2, half
of what they differ by once rotation is taken off. With each read-out as the instrument for the other, the
normal equations have |c|^2 - S_m in the place of |c|^2. Below some 20 mHz the masses themselves move apart;
S_m is measured above, where it must be white.

That alone is not enough. The drag-free loop steers after these read-outs, and the spacecraft follows their
noise: y = j - T m, of which the instruments see

    E[c* m] = (1 - T*) S_m .

Above the bandwidth T is small, near it a few per cent of b_3 depend on it, and its shape is unknown. But T
is causal: the spacecraft answers to noise after it was read, not before. So T is fitted along, as a sum of
causal (Laguerre) functions t_k T_k. Instruments for the t_k are c times T_k* S_m / S_c, the shapes in which
c contains m. A bin does not contribute to the S_c it is divided by: that would tie the instruments to
the very noise they are to be free of, and pull b back by some 0.2 sigma. In the time domain, the half of the
correlation of residual and read-outs in which the read-out comes first then gives b_3, and the other half
the loop. That costs a factor of two to three in sigma.

What is subtracted from Delta g_x stays least squares: that subtracts best, attenuated or not.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.crosstalk import readout_noise
from fit.crosstalk.fitted_run import FittedRun
from fit.crosstalk.noise_share import noise_share
from fit.fitting import IRLSResult, constraints, parameter_values, prior_rows, varying
from fit.model import dynamics
from fit.spectra import Spectrum, fit_noise, windowing
from fit.whitening import whitened_run

Array = NDArray[np.float64]

LOOP_PRIOR_SIGMA = 30.0  # width of the weak prior of t_k, about zero: the largest T is some 2
MAX_SIGMA_RATIO = 10.0  # to least squares, which is kept beyond unless it is off by more
MAX_NOISE_FRACTION = 0.7  # share of noise in some combination, from which least squares is kept
LOOP_ORDER = 8  # of the loop; for unity gains of 15 to 80 mHz it leaves 0.1 sigma of 13 runs, 4 would leave 3
LOOP_POLE = 2 * np.pi * 40e-3  # rad/s, where the functions turn
LOOP_DELAY = 0.3  # s, of thrusters
#: The coefficients of each mean, those of its acceleration and of its position.
COEFFICIENTS_OF: Mapping[str, tuple[str, str]] = {"y": ("b_3", "b_5"), "z": ("b_4", "b_6")}


@dataclass(frozen=True)
class NoisyRegressor:
    """One of the means y and z in one run; everything whitened.

    Attributes
    ----------
    indices : list of int
        Where the parameters of the run have its coefficients, those of acceleration and position.
    noise_power : ndarray, shape (B,)
        Power of the noise of the acceleration.
    uncertainty : float
        Of that power, relative.
    loop : ndarray of complex, shape (B, LOOP_ORDER)
        What T_k adds to the product of acceleration and residual: T_k* times the smooth power of the noise of
        the acceleration, times the force per acceleration.
    filters : ndarray of complex, shape (B, 2 + LOOP_ORDER)
        What makes its instruments of the acceleration: 1, that of the position, those of the loop.
    """

    indices: list[int]
    noise_power: Array
    uncertainty: float
    loop: Spectrum
    filters: Spectrum


def noisy_regressor(w: FittedRun, name: str, theta: Array) -> NoisyRegressor | None:
    """Return what the instruments of a mean need; None where the read-outs differ by more than noise.

    `theta`, shape (P,), is the estimate of least squares.
    """
    f, noise = w.terms.f, readout_noise.mean_psd(w.experiment.sysid, name)
    if noise is None:
        return None
    level, uncertainty = noise
    omega2 = (2 * np.pi * f) ** 2
    white = omega2**2 * level
    indices = _indices(w, name)
    power = np.abs(w.terms.columns[:, indices[0] + 1]) ** 2
    smooth = fit_noise(f, power, np.ones(f.size)).leave_one_out(f, power)
    T, noise_power = _causal(f).conj(), 2 * white / w.S
    acceleration, position = w.block.parameter_map[indices] @ theta
    loop = (acceleration - position / omega2)[:, None] * T
    filters = np.column_stack([np.ones(f.size), -1 / omega2, loop * np.minimum(white / smooth, 1.0)[:, None]])
    return NoisyRegressor(indices, noise_power, uncertainty, loop * noise_power[:, None], filters)


def _indices(w: FittedRun, name: str) -> list[int]:
    """Return where the parameters of a run have the coefficients of a mean."""
    return [w.experiment.parameters.index(b) for b in COEFFICIENTS_OF[name]]


def _causal(f: Array) -> Spectrum:
    """Return the Laguerre functions at the frequencies f, shape (B, LOOP_ORDER), 1 at f = 0."""
    s = 2j * np.pi * f[:, None]
    return np.asarray(
        LOOP_POLE
        / (s + LOOP_POLE)
        * ((LOOP_POLE - s) / (s + LOOP_POLE)) ** np.arange(LOOP_ORDER)
        * np.exp(-LOOP_DELAY * s)
    )


@dataclass(frozen=True)
class MomentEquations:
    """One run: K parameters of its own, then LOOP_ORDER of the loop for each of its M means.

    Attributes
    ----------
    means : mapping of tuple of int and str to NoisyRegressor
        Those with instruments, by alignment epoch and name.
    regressors : ndarray of complex, shape (B, K)
        Whitened.
    instruments : ndarray of complex, shape (B, K + LOOP_ORDER M)
        Whitened and weighed.
    residual : ndarray of complex, shape (B,)
        Of least squares.
    b : ndarray, shape (K,)
        Its estimate.
    map : ndarray, shape (K + LOOP_ORDER M, P + U)
        From what is fitted to what the run has.
    spread : float
        What the window adds to the scatter of sums over bins.
    weights : ndarray, shape (B,)
        Of the bins.
    """

    means: Mapping[tuple[int, str], NoisyRegressor]
    regressors: Spectrum
    instruments: Spectrum
    residual: Spectrum
    b: Array
    map: Array
    spread: float
    weights: Array

    @property
    def corrected(self) -> list[int]:
        """Where what is fitted has the coefficients of its means."""
        indices = [i for mean in self.means.values() for i in mean.indices]
        return [int(j) for j in np.flatnonzero(self.map[indices].any(axis=0))]

    def _rows(self) -> list[tuple[NoisyRegressor, list[int], slice]]:
        """Return each mean with the rows of its instruments, and where its loop is among the columns."""
        K = self.regressors.shape[1]
        loops = [slice(K + i * LOOP_ORDER, K + (i + 1) * LOOP_ORDER) for i in range(len(self.means))]
        return [
            (mean, [*mean.indices, *range(loop.start, loop.stop)], loop)
            for mean, loop in zip(self.means.values(), loops, strict=True)
        ]

    @cached_property
    def noise(self) -> list[Array]:
        """What each mean's noise adds to the products of instruments and regressors, of the shape of `A`."""
        size, products = self.instruments.shape[1], []
        for mean, rows, _ in self._rows():
            C = np.zeros((size, size))
            weights = (self.weights * mean.noise_power)[:, None]
            C[np.ix_(rows, mean.indices)] = (mean.filters.conj().T @ (mean.filters[:, :2] * weights)).real
            products.append(C)
        return products

    @cached_property
    def A(self) -> Array:
        """Expected change of the moments with what is fitted, shape (K + LOOP_ORDER M, K + LOOP_ORDER M)."""
        K = self.regressors.shape[1]
        A = np.zeros(2 * self.instruments.shape[1:])
        A[:, :K] = (self.instruments.conj().T @ self.regressors).real
        A -= np.sum(self.noise, axis=0)
        for mean, rows, loop in self._rows():
            A[rows, loop] = (mean.filters.conj().T @ (mean.loop * self.weights[:, None])).real
        return A

    def bin_moments(self, change: Array) -> Array:
        """Return the moments of each bin, (B, K + LOOP_ORDER M), at a change of what is fitted."""
        K = self.regressors.shape[1]
        b = self.b + change[:K]
        residual = self.residual + self.regressors @ change[:K]
        moments = (self.instruments.conj() * residual[:, None]).real
        for mean, rows, loop in self._rows():
            noise = mean.filters[:, :2] @ b[list(mean.indices)] * mean.noise_power - mean.loop @ change[loop]
            expected_noise = mean.filters.conj() * noise[:, None]
            moments[:, rows] -= expected_noise.real * self.weights[:, None]
        return moments

    def covariance(self, change: Array) -> Array:
        """Return the covariance of the moments at a change of what is fitted, shape (P + U, P + U)."""
        per_bin = self.bin_moments(change) @ self.map
        covariance = self.spread * per_bin.T @ per_bin
        b = np.zeros(len(change))
        b[: self.b.size] = self.b + change[: self.b.size]
        for mean, C in zip(self.means.values(), self.noise, strict=True):
            level_error = mean.uncertainty * (C @ b) @ self.map
            covariance += np.outer(level_error, level_error)
        return np.asarray(covariance)


def estimate(
    outcome: IRLSResult, fitted_runs: Sequence[FittedRun], shifts: Mapping[str, float]
) -> tuple[IRLSResult, frozenset[str]]:
    """Estimate b_3 to b_6 without attenuation, where all runs of an alignment epoch have instruments.

    All other parameters are estimated together with them, so that attenuation is removed from these as well.

    Parameters
    ----------
    outcome : IRLSResult
        Of the joint fit.
    fitted_runs : sequence of FittedRun
        Its runs.
    shifts : mapping of str to float
        Parameters that read-out noise shifts, and by how many sigma; NaN where that is unknown. A mean of
        which none is among them keeps least squares and its smaller sigma.

    Returns
    -------
    outcome : IRLSResult
        The fit, with the estimate of instrumental variables as its solution.
    names : frozenset of str
        The parameters that are estimated without attenuation.

    Raises
    ------
    FitError
        If a noise PSD cannot be fitted.
    """
    if any(w.block.window is None for w in fitted_runs):
        return outcome, frozenset()
    of_runs = [(w, _noisy_regressors(w, outcome.solution.theta)) for w in fitted_runs]
    labels = {label for w, means in of_runs for label in means if _is_shifted(outcome, w, label[1], shifts)}
    labels -= {label for _, means in of_runs for label, mean in means.items() if mean is None}
    while labels:
        runs = [_moment_equations(w, outcome, means, sorted(labels)) for w, means in of_runs]
        rejected = _noise_dominated(outcome, runs)
        if not rejected:
            solution = _solution(outcome, runs)
            cost = outcome.solution.in_sigma(solution.sigma)
            max_cost = [np.fmax(MAX_SIGMA_RATIO, abs(shifts.get(p.name, 0.0))) for p in outcome.parameters]
            too_costly = cost > max_cost
            rejected = {
                label
                for run in runs
                for label, mean in run.means.items()
                if too_costly[np.argmax(run.map[mean.indices[0]] != 0)]  # the coefficient of its acceleration
            }
        if not rejected:
            names = frozenset(outcome.parameters[j].name for run in runs for j in run.corrected)
            return replace(outcome, solution=solution), names
        labels -= rejected
    return outcome, frozenset()


def _noisy_regressors(w: FittedRun, theta: Array) -> dict[tuple[int, str], NoisyRegressor | None]:
    """Return what the instruments of the means of a run need, by alignment epoch and name."""
    run = w.experiment.sysid
    names = [name for name in COEFFICIENTS_OF if name in run.channels.means]
    return {(run.telemetry.alignment_epoch, name): noisy_regressor(w, name, theta) for name in names}


def _is_shifted(outcome: IRLSResult, w: FittedRun, name: str, shifts: Container[str]) -> bool:
    """Return whether a coefficient of a mean is shifted, and that of its acceleration is determined."""
    rows = w.block.parameter_map[_indices(w, name)] != 0
    is_shifted = np.array([p.name in shifts for p in outcome.parameters])
    return not outcome.undetermined[rows[0]].any() and bool(is_shifted[rows.any(axis=0)].any())


def _moment_equations(
    w: FittedRun,
    outcome: IRLSResult,
    means_of_run: Mapping[tuple[int, str], NoisyRegressor | None],
    labels: Sequence[tuple[int, str]],
) -> MomentEquations:
    """Return the equations of a run for those of its means that have a label among `labels`."""
    means = {label: mean for label, mean in means_of_run.items() if mean and label in labels}
    theta, K, P = w.block.parameter_map @ outcome.solution.theta, *w.block.parameter_map.shape
    U, _ = whitened_run.whiten(w.terms, w.S)
    regressors: Spectrum = U @ dynamics.gradient(theta, w.terms.tau)
    weights = w.block.weights.fit
    # Filtered first and projected then: what the projection spreads over all bins is far below the motion
    # there, but far above it in the lowest, which the filters of a slow force weigh most.
    loops: list[Spectrum] = [
        whitened_run.whiten(
            replace(w.terms, columns=mean.filters[:, 2:] * w.terms.columns[:, [mean.indices[0] + 1]]), w.S
        )[0]
        for mean in means.values()
    ]
    to_run = np.zeros((K + LOOP_ORDER * len(means), P + LOOP_ORDER * len(labels)))
    to_run[:K, :P] = w.block.parameter_map
    for i, label in enumerate(means):
        row, column = K + i * LOOP_ORDER, P + LOOP_ORDER * labels.index(label)
        to_run[row : row + LOOP_ORDER, column : column + LOOP_ORDER] = np.eye(LOOP_ORDER)
    assert w.block.window is not None
    return MomentEquations(
        means,
        regressors,
        np.asarray(np.concatenate([regressors, *loops], axis=1) * weights[:, None], dtype=np.complex128),
        U @ dynamics.coefficients(theta, w.terms.tau),
        theta,
        to_run,
        windowing.variance_factor(w.block.window),
        weights,
    )


def _noise_dominated(outcome: IRLSResult, runs: Sequence[MomentEquations]) -> set[tuple[int, str]]:
    """Return the means whose noise is nearly all that the data say in some direction."""
    P = outcome.solution.theta.size
    width = np.array([p.prior_sigma for p in outcome.parameters])
    prior = prior_rows(outcome.result.params)[0]
    H = whitened_run.information(outcome.whitened_runs, outcome.solution.theta) + prior.T @ prior
    noise_of_label: dict[tuple[int, str], Array] = {}
    for run in runs:
        for label, C in zip(run.means, run.noise, strict=True):
            total = noise_of_label.setdefault(label, np.zeros((P, P)))
            total += (run.map.T @ C @ run.map)[:P, :P]
    return {
        label
        for label, C in noise_of_label.items()
        if noise_share(H, C, width, outcome.free)[0].max(initial=0.0) > MAX_NOISE_FRACTION
    }


def _solution(outcome: IRLSResult, runs: Sequence[MomentEquations]) -> whitened_run.Solution:
    """Solve the moments of all runs for what changes least squares, within the constraints.

    The covariance is that without bounds.
    """
    theta, (prior, centre) = outcome.solution.theta, prior_rows(outcome.result.params)
    extra = runs[0].map.shape[1] - theta.size
    rows = scipy.linalg.block_diag(prior, np.eye(extra) / LOOP_PRIOR_SIGMA)
    free = scipy.linalg.block_diag(outcome.free, np.eye(extra))
    A = rows.T @ rows + np.sum([run.map.T @ run.A @ run.map for run in runs], axis=0)
    score = rows.T @ np.concatenate([prior @ theta - centre, np.zeros(extra)])
    for run in runs:
        score += run.map.T @ run.bin_moments(np.zeros(len(run.map))).sum(axis=0)
    inverse = whitened_run.scaled_inverse(A, free)
    change = _change_within_bounds(outcome, A, score, free)
    scores = rows.T @ rows
    for run in runs:
        scores += run.covariance(run.map @ change)
    covariance = (inverse @ scores @ inverse.T)[: theta.size, : theta.size]
    symmetric = (covariance + covariance.T) / 2
    # ties, fixed values and bounds hold exactly
    estimate = parameter_values(constraints.params_at(outcome.result.params, theta + change[: theta.size]))
    return replace(outcome.solution, theta=estimate, covariance=symmetric)


def _change_within_bounds(outcome: IRLSResult, A: Array, score: Array, free: Array) -> Array:
    """Solve ``A change = -score``, shape (P + U,), along free directions; beyond a bound it ends there."""
    theta, params = outcome.solution.theta, list(outcome.result.params.values())
    places, A, score = varying(outcome.result.params), free.T @ A @ free, free.T @ score
    fixed_changes = dict[int, float]()
    while True:
        interior = np.array([k for k in range(len(A)) if k not in fixed_changes])
        change = np.zeros(len(A))
        change[[*fixed_changes]] = [*fixed_changes.values()]
        change[interior] = -whitened_run.scaled_inverse(A[np.ix_(interior, interior)]) @ (
            score[interior] + A[interior] @ change
        )
        violations = {
            k: float(np.clip(theta[i] + change[k], params[i].min, params[i].max) - theta[i])
            for k, i in enumerate(places)
            if k not in fixed_changes and not params[i].min <= theta[i] + change[k] <= params[i].max
        }
        if not violations:
            return np.asarray(free @ change)
        fixed_changes |= violations
