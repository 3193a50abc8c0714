"""Runs of a simulated loop as weighted least squares, linear about the last trial."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.fitting import readout_excess_noise
from fit.identification import series
from fit.identification.loop import FORCE_1, THRUST, Loop
from fit.identification.parameters import JointParameters
from fit.model import dynamics
from fit.spectra import NoiseModel, Spectra, windowing
from fit.whitening import (
    Experiment,
    Likelihood,
    ResidualSpectrum,
    Run,
    fit_residual_noise,
    weights,
    whitened_run,
)

Array = NDArray[np.float64]

RELINEARISE_SIGMA = 3.0  # sigma, distance from the expansion point that requires new derivatives
STEP_LIMIT = 0.1  # of its natural scale, largest sigma for that purpose
STEP = 1e-3  # of its natural scale, by which a parameter is varied unless its sigma is smaller
MOTION = 1e-9  # m, for a sample, that a controller answers
IMPULSE = 1e-6  # N, for a sample: moves test mass 1 by some nanometres


@dataclass(frozen=True)
class LinearisedRun(whitened_run.WhitenedRun):
    """A whitened run: the residual at a trial, then its derivatives by the K parameters of the run.

    Attributes
    ----------
    expansion_point : ndarray, shape (P,)
        The trial.
    """

    expansion_point: Array = field(kw_only=True)

    def coefficients(self, theta: Array) -> Array:
        """As those of `WhitenedRun`."""
        shift = theta - (self.expansion_point if theta.ndim == 1 else self.expansion_point[:, None])
        return np.concatenate([np.ones_like(theta[:1]), self.parameter_map @ shift])

    def run_gradient(self, _: Array, /) -> Array:
        """As those of `WhitenedRun`."""
        return np.eye(len(self.parameter_map) + 1, len(self.parameter_map), k=-1)


class MeasuredInputs:
    """A run and its simulated loop, on which the measured inputs are imposed.

    Parameters
    ----------
    run : Run
        As measured, with what is masked.
    loop : Loop
        Simulates it.
    dynamics_parameters : ndarray, shape (7,)
        Of `dynamics.PARAMETERS`, by which forces are computed from motions.
    controller : mapping of str to float
        Parameters of the loop with whose controller they are.
    """

    def __init__(
        self, run: Run, loop: Loop, dynamics_parameters: Array, controller: Mapping[str, float]
    ) -> None:
        self.telemetry, self._loop = run.telemetry, loop
        self._dynamics_parameters, self._controller = dynamics_parameters, controller
        self._run = run
        self._o_1, self._o_12, force_1 = (
            series.at_loop_rate(run.telemetry, name) for name in ("o_1", "o_12", "f_x_1")
        )
        self._inputs = {FORCE_1: force_1, THRUST: np.zeros(force_1.size)}
        self._grid = series.reduced_grid(run.telemetry, run.channels)
        self._impulse = series.impulse(force_1.size, IMPULSE)
        self._motion_response = self._force_response = self._initial_transient = np.empty(0)

    def measured_derivatives(self, names: Sequence[str]) -> Array:
        """Return the derivatives of the residual by parameters of the equation, shape (names, N).

        From what was measured, as in the fit, and zero where the run has nothing of it: of motion that the
        loop does not predict, and of gains and delays that are not identified but differ between runs.
        """
        theta, run = self._dynamics_parameters, self._run
        tau = dynamics.delays(theta)
        columns = run.columns(tau)
        extra_names = columns.names[len(dynamics.COLUMNS) :]
        gradient = dynamics.gradient(np.concatenate([theta, np.zeros(len(extra_names))]), tau)
        derivatives = dict(zip((*dynamics.PARAMETERS, *extra_names), gradient.T, strict=True))
        indices, values = self._grid_indices(columns), np.zeros((len(names), self._grid.time.size))
        for row, name in zip(values, names, strict=True):
            if name in derivatives:
                row[:] = (columns.values @ derivatives[name])[indices]
        return values

    def motion(self) -> Array:
        """Return what `readout_excess_noise.O_1_COLUMNS` is, shape (2, N)."""
        columns = self._run.columns((0.0, 0.0))
        return columns.values[self._grid_indices(columns)][:, list(readout_excess_noise.O_1_COLUMNS)].T

    def _grid_indices(self, columns: dynamics.Columns) -> NDArray[np.intp]:
        indices = np.rint((self._grid.time - columns.time[0]) * columns.fs).astype(np.intp)
        return np.asarray(np.clip(indices, 0, columns.time.size - 1))

    def residual(self, theta: Mapping[str, float]) -> Array:
        """Return the force [m s^-2] that the simulated loop lacks, the measured o_1 imposed."""
        if not self._motion_response.size:
            self.update_impulse_response(theta)
        response = self._response(theta)
        discrepancy = self._o_1 - response["o_1"]
        self._inputs[THRUST] = self._inputs[THRUST] + series.stray_thrust(
            discrepancy, self._impulse, self._motion_response
        )
        return self._excess_force(discrepancy, self._o_12 - response["o_12"])

    def update_impulse_response(self, theta: Mapping[str, float]) -> None:
        """Simulate the response to a stray thrust with theta, by which o_1 is imposed."""
        still = {FORCE_1: np.zeros(self._impulse.size), THRUST: np.zeros(self._impulse.size)}
        reference = self._loop.response(self.telemetry, theta, still)
        impulse_response = self._loop.response(self.telemetry, theta, {**still, THRUST: self._impulse})
        self._motion_response = impulse_response["o_1"] - reference["o_1"]
        self._force_response = self._force(impulse_response["o_12"] - reference["o_12"])
        if not self._initial_transient.size:
            unit_sample = np.where(np.arange(self._impulse.size) == 0, MOTION, 0.0)
            answer = self._loop.command(self.telemetry, self._controller, unit_sample)
            self._initial_transient = series.initial_transient(answer, self._o_1.size)

    def residual_difference(self, upper: Mapping[str, float], lower: Mapping[str, float]) -> Array:
        """Return by how much the residual at one trial exceeds that at another, both near the last."""
        high, low = self._response(upper), self._response(lower)
        return self._excess_force(low["o_1"] - high["o_1"], low["o_12"] - high["o_12"])

    def _excess_force(self, o_1: Array, o_12: Array) -> Array:
        """Return the force of a motion in excess of that of the stray thrust that moves o_1."""
        return self._force(o_12) - series.response_force(o_1, self._motion_response, self._force_response)

    def transformed(self, columns: Sequence[Array]) -> Spectra:
        """Return the spectra of series on the grid of residuals."""
        values = np.stack(columns, axis=1)
        grid = self._grid
        nuisance = [grid.steps, self._initial_transient]
        return windowing.transform(values, grid.valid, grid.fs, nuisance=nuisance)

    def _response(self, theta: Mapping[str, float]) -> Mapping[str, Array]:
        return self._loop.response(self.telemetry, theta, self._inputs)

    def _force(self, o_12: Array) -> Array:
        answer = self._loop.command(self.telemetry, self._controller, o_12)
        return series.force(o_12, answer, self._dynamics_parameters)


class SimulatedExperiment:
    """Weighs an experiment by its noise run, both against the simulated loop.

    Parameters
    ----------
    experiment : Experiment
        As it is to be fitted.
    loop : Loop
        Simulates it.
    joint : JointParameters
        The P joint parameters.
    index : int
        Number of the experiment among those of `joint`.
    likelihood : str
        What the residual is taken to be like.
    """

    converged = True

    def __init__(
        self,
        experiment: Experiment,
        loop: Loop,
        joint: JointParameters,
        index: int,
        likelihood: Likelihood,
    ) -> None:
        self.name = experiment.name
        inverse = joint.dynamics[index], joint.run_parameters(index, joint.start)
        self._sysid = MeasuredInputs(experiment.sysid, loop, *inverse)
        self._noise = experiment.noise and MeasuredInputs(experiment.noise, loop, *inverse)
        self._names, self._share, self._likelihood = joint.names, joint.maps[index], likelihood
        self._widths, self._low, self._high = joint.scales
        self._measured_names = names = joint.measured_names[index]
        self._measured_columns = [
            run.measured_derivatives(names) for run in (self._sysid, self._noise) if run
        ]
        self._excess_motion = list(self._sysid.motion()) if experiment.readout_excess else []
        self._model: NoiseModel | None = None
        self._derivative_columns: list[Array] = []
        self._residuals: list[Array] = []
        self._expansion_point = np.full(len(joint.names), np.nan)
        self._simulated_at = np.full(len(joint.parameters), np.nan)

    def simulate(self, theta: Array) -> None:
        """Simulate the runs with theta, shape (P,), which `block` is to be asked for next.

        Raises
        ------
        FitError
            If that cannot be done.
        """
        if not np.array_equal(theta, self._simulated_at):
            run_parameters = self._run_parameters(theta)
            self._residuals = [run.residual(run_parameters) for run in (self._sysid, self._noise) if run]
            self._simulated_at = theta

    def block(self, theta: Array, covariance: Array, iteration: int) -> LinearisedRun:
        """Return the run weighed at the estimate theta, shape (P,), of that covariance, shape (P, P)."""
        self.simulate(theta)
        n, run_parameters = len(self._names), self._share @ theta
        residuals = [
            r + run_parameters[n:] @ x for r, x in zip(self._residuals, self._measured_columns, strict=True)
        ]
        sigma = np.sqrt(np.diag(self._share @ covariance @ self._share.T))[:n]
        step = np.where(sigma > 0, np.minimum(sigma, STEP * self._widths), STEP * self._widths)
        tolerance = np.maximum(step, np.minimum(sigma, STEP_LIMIT * self._widths))
        if not np.max(np.abs(run_parameters[:n] - self._expansion_point) / tolerance) < RELINEARISE_SIGMA:
            self._derivative_columns = self._derivatives(run_parameters[:n], step)
            self._expansion_point = run_parameters[:n]
        terms = self._sysid.transformed([residuals[0], *self._derivative_columns, *self._excess_motion])
        if self._excess_motion:
            with_parameters = replace(terms, columns=terms.columns[:, : -len(self._excess_motion)])
            terms = readout_excess_noise.use_injections_only(
                with_parameters, terms.columns[:, -len(self._excess_motion) :]
            )
        self._model = self._smooth(terms, residuals, covariance)
        U, _ = whitened_run.whiten(terms, self._model.expected(terms.f))
        u = np.abs(U[:, 0]) ** 2 if iteration else np.full(len(U), 2.0)
        return LinearisedRun(
            tau=terms.tau,
            columns=U,
            weights=weights(self._likelihood, terms.f, u),
            window=terms.window,
            parameter_map=self._share,
            noise=self._model,
            n_projected=terms.nuisance.shape[1],
            f=terms.f,
            names=(*self._names, *(name for name in self._measured_names if name in dynamics.PARAMETERS)),
            expansion_point=theta,
        )

    def _smooth(self, terms: Spectra, residuals: Sequence[Array], covariance: Array) -> NoiseModel:
        """Return the PSD of the noise run, or without one of the residual itself."""
        try:
            size = len(self._share)
            fit_gradient = (np.eye(size + 1, size, k=-1), self._share @ covariance @ self._share.T)
            residual_spectrum = ResidualSpectrum(terms, np.eye(1 + size)[0], fit_gradient)
            if not self._noise:
                return fit_residual_noise(residual_spectrum, self._model)
            return fit_residual_noise(
                ResidualSpectrum(self._noise.transformed([residuals[1]]), np.ones(1)),
                self._model,
                residual_spectrum,
            )
        except FitError as error:
            run = (self._noise or self._sysid).telemetry.run
            raise FitError(
                f"{run}: what the simulated loop leaves of it is not like noise: {error}"
            ) from None

    def _run_parameters(self, theta: Array) -> dict[str, float]:
        return self._named(self._share[: len(self._names)] @ theta)

    def _named(self, run_parameters: Array) -> dict[str, float]:
        return dict(zip(self._names, run_parameters.tolist(), strict=True))

    def _derivatives(self, run_parameters: Array, step: Array) -> list[Array]:
        """Return the derivatives of the residual by the K parameters, linearised at `run_parameters`."""
        for run in (self._sysid, self._noise) if self._derivative_columns else ():
            if run:
                run.update_impulse_response(self._named(run_parameters))
        by_loop = [
            self._derivative(run_parameters, h * unit)
            for h, unit in zip(step, np.eye(step.size), strict=True)
        ]
        return [*by_loop, *self._measured_columns[0]]

    def _derivative(self, run_parameters: Array, h: Array) -> Array:
        """Return the derivative by a parameter from a central difference."""
        # what departs may be beyond the bounds of what it departs from
        upper = np.minimum(run_parameters + h, np.maximum(self._high, run_parameters))
        lower = np.maximum(run_parameters - h, np.minimum(self._low, run_parameters))
        shift = self._sysid.residual_difference(self._named(upper), self._named(lower))
        if not np.isfinite(shift).all():
            values = ", ".join(f"{name} = {value:.6g}" for name, value in self._named(lower).items())
            run = self._sysid.telemetry.run
            raise FitError(f"run '{run}' at {values}: the response to a step in a parameter is not finite")
        return np.asarray(shift / np.sum(upper - lower))
