"""Test of one run against what the other runs determine, as it was recorded and with corrections.

The parameters of the run are known from the joint fit of the others, with the weak priors for what these do
not determine. They are refitted within that knowledge, and the residual is compared with the PSD of the noise
run. A correction explains the run if chi^2, prior knowledge included, is that of noise, if free coefficients
of the columns explain no more than noise makes them, and if the residual is as strong in all of the run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.consistency.scans import as_complex
from fit.consistency.score_test import ScoreTest
from fit.consistency.template_effects import RunSeries
from fit.false_alarms import p_limit
from fit.fitting import IRLSResult
from fit.model import Sharing, dynamics
from fit.spectra import NoiseModel, Spectra, windowing
from fit.telemetry import Telemetry
from fit.whitening import Experiment, Run, noise_model, whitened_run

Array = NDArray[np.float64]

MAX_EXCESS = 1.2  # power of the residual in units of that of the noise run, either way
BLOCK = 300.0  # s, over which the power of the residual is averaged
MAX_LEVEL_CHANGE = 1.25  # factor on o_12 up to which its noise may be scaled along


@dataclass(frozen=True)
class Correction:
    """What is changed about a run.

    Attributes
    ----------
    channels : mapping of str to ndarray, each of shape (N,)
        Series in place of those of `dynamics.CHANNELS`, at the rate of the fit.
    acceleration : ndarray, shape (M,), or None
        What is subtracted from Delta g [m s^-2], at the times of the columns.
    masked : tuple of tuple of float
        Begin and end [s] of segments that are masked.
    o_12_scale : float
        Factor on the scale of o_12, and with it on the noise.
    labels : Telemetry or None
        Run with other authority and alignment epoch.
    """

    channels: Mapping[str, Array] = field(default_factory=dict)
    acceleration: Array | None = None
    masked: tuple[tuple[float, float], ...] = ()
    o_12_scale: float = 1.0
    labels: Telemetry | None = None


class RunTest:
    """A run, its parameters as the other runs determine them, and its noise.

    Parameters
    ----------
    experiment : Experiment
        The run and its noise run.
    joint : IRLSResult
        The joint fit of the other runs.
    others : sequence of Experiment
        The other runs.
    sharing : Sharing
        What all of them share.
    single_fit : IRLSResult, optional
        The fit of the run by itself; needed without a noise run.

    Attributes
    ----------
    parameters : dict of str to float
        Joint parameters.
    theta : ndarray, shape (Q,)
        Parameters of the run.
    epochs : set of int
        Alignment epochs whose leakage the other runs determine.
    """

    def __init__(
        self,
        experiment: Experiment,
        joint: IRLSResult,
        experiments: Sequence[Experiment],
        sharing: Sharing,
        single_fit: IRLSResult | None = None,
    ) -> None:
        self.experiment, self._sharing = experiment, sharing
        runs = [(e.sysid.telemetry, e.parameters) for e in (*experiments, experiment)]
        priors = sharing.parameters(runs)
        names = [p.name for p in priors]
        values = np.array([p.value for p in priors])
        covariance = np.diag([p.prior_sigma**2 for p in priors])
        fitted = {p.name: k for k, p in enumerate(joint.parameters)}
        i = [k for k, name in enumerate(names) if name in fitted]
        j = [fitted[names[k]] for k in i]
        values[i] = joint.solution.theta[j]
        covariance[np.ix_(i, i)] = joint.solution.covariance[np.ix_(j, j)]
        for name, (width, _) in joint.scatter.items():
            if name in names:
                covariance[names.index(name), names.index(name)] += width**2
        self.parameters = dict(zip(names, values.tolist(), strict=True))
        self._covariance = covariance
        by_epoch = sharing.groups["delta_ifo"] == "alignment_epoch"
        self.epochs = {e.sysid.telemetry.alignment_epoch for e in experiments} if by_epoch else set()
        self.theta, P = self._run_parameters(self.telemetry)
        estimates = [(self.theta, P)] if experiment.noise else []
        if single_fit:
            share, solution = single_fit.whitened_runs[0].parameter_map, single_fit.solution
            estimates.append((share @ solution.theta, share @ solution.covariance @ share.T))
        self.tau = dynamics.delays(self.theta)
        self._noise = _smallest_noise(experiment, estimates)

    @property
    def telemetry(self) -> Telemetry:
        """The run itself."""
        return self.experiment.sysid.telemetry

    @cached_property
    def recorded(self) -> "CorrectedRun":
        """The run without a correction."""
        return self.corrected(Correction())

    @cached_property
    def series(self) -> RunSeries:
        """The run as templates see it."""
        run, columns = self.experiment.sysid, self.recorded.columns
        largest = tuple(float(np.abs(run.channels.series[f"f_x_{j}"]).max()) for j in (1, 2))
        return RunSeries(run, columns, self.recorded.coefficients, (largest[0], largest[1]), self.theta)

    def whitened(self, series: Array) -> Array:
        """Return accelerations, shape (M, E), as whitened columns with prior rows, shape (2 B + Q, E)."""
        return self.recorded.with_prior_rows(self.recorded.whitened(series))

    def channel_effects(self, name: str, series: Array) -> Array:
        """Return the whitened effects of series added to a channel, (N, E), shape (2 B + Q, E)."""
        effects = [self.series.effect(name, column) for column in series.T]
        return self.whitened(np.stack(effects, axis=1))

    def corrected(self, correction: Correction) -> "CorrectedRun":
        """Return the run with a correction."""
        run = self.experiment.sysid
        if correction.channels:
            run = run.with_channels(correction.channels)
        if correction.masked:
            run = run.mask(correction.masked)
        columns = run.columns(self.tau)
        if correction.acceleration is not None:
            values = columns.values.copy()
            values[:, 0] -= correction.acceleration
            columns = replace(columns, values=values)
        spectra = run.transformed(columns.values, columns)
        scale = correction.o_12_scale
        level = scale if 1 / MAX_LEVEL_CHANGE < abs(scale) < MAX_LEVEL_CHANGE else 1.0
        theta, P = self._run_parameters(correction.labels or self.telemetry)
        S = self._noise.expected(spectra.f) / level**2
        prior_root = dynamics.gradient(theta, self.tau) @ whitened_run.matrix_sqrt(P).T
        return CorrectedRun(run, columns, spectra, S, dynamics.coefficients(theta, self.tau), prior_root)

    def _run_parameters(self, labels: Telemetry) -> tuple[Array, Array]:
        """Return the parameters of a run with these labels and their covariance, shapes (Q,) and (Q, Q)."""
        share = self._sharing.matrix(labels, self.experiment.parameters, [*self.parameters])
        return share @ np.array([*self.parameters.values()]), share @ self._covariance @ share.T


def _smallest_noise(experiment: Experiment, estimates: Sequence[tuple[Array, Array]]) -> NoiseModel:
    """Return the smallest of the PSDs of the noise at estimates of the parameters and their covariances.

    A noise run has its least residual with its true parameters: those of the other runs where a channel of
    the sysid run is wrong, those of the run by itself where its parameters differ.
    """
    models = [noise_model(experiment, theta, covariance, None) for theta, covariance in estimates]
    f = np.exp(models[0].knots)
    return min(models, key=lambda model: float(np.sum(np.log(model.expected(f)))))


@dataclass(frozen=True)
class CorrectedRun:
    """A whitened run, tested against the other runs.

    Attributes
    ----------
    run : Run
        With its corrections.
    columns : dynamics.Columns
        M samples long.
    spectra : Spectra
        Of the columns.
    S : ndarray, shape (B,)
        PSD of the noise.
    coefficients : ndarray, shape (K,)
        Of the columns, as the other runs determine them.
    prior_root : ndarray, shape (K, Q)
        Change of the coefficients by one sigma of each direction of prior knowledge.
    """

    run: Run
    columns: dynamics.Columns
    spectra: Spectra
    S: Array
    coefficients: Array
    prior_root: Array

    def whitened(self, series: Array) -> Array:
        """Return accelerations, shape (M, E), as whitened columns, shape (2 B, E)."""
        spectra = self.run.transformed(series, self.columns)
        return whitened_run.as_real(whitened_run.whiten(spectra, self.S)[0])

    def with_prior_rows(self, columns: Array) -> Array:
        """Return whitened columns, shape (2 B, E), with the prior rows that they do not change."""
        return np.concatenate([columns, np.zeros((self.prior_root.shape[1], columns.shape[1]))])

    @cached_property
    def U(self) -> Array:
        """Whitened columns, shape (2 B, K)."""
        return whitened_run.as_real(whitened_run.whiten(self.spectra, self.S)[0])

    @cached_property
    def test(self) -> ScoreTest:
        """Score test of further effects, with 2 B + Q rows.

        Noisy read-outs attenuate cross-talk differently in every run, so that it is free.
        """
        Q = self.prior_root.shape[1]
        known = np.concatenate([self.U @ self.prior_root, np.eye(Q)])
        free = self.with_prior_rows(self.U[:, len(dynamics.COLUMNS) :])
        r = np.concatenate([self.U @ self.coefficients, np.zeros(Q)])
        return ScoreTest(r, np.hstack([known, free]))

    @cached_property
    def residual(self) -> Array:
        """Whitened residual, shape (2 B,)."""
        return self.test.residual[: len(self.U)]

    @cached_property
    def free(self) -> ScoreTest:
        """The same with coefficients that the other runs do not determine."""
        return ScoreTest(self.U[:, 0], self.U[:, 1:])

    @property
    def chi2(self) -> float:
        """Least sum of squares, prior knowledge included."""
        return self.test.chi2

    @property
    def level(self) -> float:
        """Power of the residual in units of that of the noise run, with free coefficients."""
        return self.free.chi2 / max(len(self.U) - self.free.rank, 1)

    @cached_property
    def is_noise(self) -> bool:
        """Whether nothing but noise remains."""
        n_known = min(self.free.rank, len(dynamics.PARAMETERS))
        excess = (self.chi2 - self.free.chi2) / max(self.level, 1.0)
        consistent = float(scipy.special.chdtrc(n_known, max(excess, 0.0))) > p_limit("runs")
        return consistent and self._is_uniform and 1 / MAX_EXCESS < self.level < MAX_EXCESS

    @cached_property
    def block_powers(self) -> Array:
        """Power of the residual in every block in units of its mean under noise."""
        n, window = self.spectra.window.size, self.spectra.window
        residual = as_complex(self.residual)[:, None]
        x = windowing.inverse_transform(residual, self.spectra.first, n)[:, 0] * np.sqrt(n / 2)
        size = round(BLOCK * self.columns.fs)
        power, weight = (np.sum(y[: n // size * size].reshape(-1, size) ** 2, axis=1) for y in (x, window))
        expected = weight / np.mean(window**2) * 2 * len(self.S) / n
        measured = expected > 0.1 * expected.max()
        return np.asarray(np.where(measured, power / np.where(measured, expected, 1.0), 1.0))

    @property
    def block_dof(self) -> float:
        """Degrees of freedom of the power of a block."""
        return 2 * len(self.S) * round(BLOCK * self.columns.fs) / self.spectra.window.size

    @property
    def _is_uniform(self) -> bool:
        level = max(1.0, float(np.median(self.block_powers)))
        largest = float(self.block_powers.max()) / level * self.block_dof
        return float(scipy.special.chdtrc(self.block_dof, largest)) > p_limit("runs", self.block_powers.size)
