"""The fit of one LISA spacecraft to expect before there are data, by Fisher information.

Every run is its noise-free response to the injections; its residual has the PSD that the cross-spectra of its
channels make. The fit subtracts what the noise in the columns adds to the scores; it carries no information.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.fitting import IRLSResult, constraints, iterate
from fit.forecasting import expected_fit, expected_run, frequency_responses
from fit.lisa.calibration import check_settings, fit_of, fitted_names
from fit.lisa.experiment import LisaExperiment, component
from fit.model import lisa_dynamics
from fit.parallel import one_blas_thread
from fit.parameters import LISA
from fit.results import Fit
from fit.settings import Settings
from fit.spectra import Spectra
from fit.whitening import Likelihood, expected_weights, whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlannedLisaExperiment:
    """An experiment that has not been flown.

    Attributes
    ----------
    experiment : LisaExperiment
        Without noise, at 1 Hz.
    cross_spectra : callable
        See `fit.forecasting.PlannedExperiment`.
    truth : mapping of str to float
        What is known of the parameters.
    arms : tuple of int
        Test masses whose long arm is measured as well.
    """

    experiment: LisaExperiment
    cross_spectra: expected_fit.CrossSpectra
    truth: Mapping[str, float] = field(default_factory=dict)
    arms: tuple[int, ...] = ()


def arm_asd(f: Array) -> Array:
    """Return the ASD of I_j [m s^-2 Hz^-1/2], shape (B,): force noise, and that of ISI and TMI read-outs.

    3 fm s^-2 Hz^-1/2 below some mHz and 9.1 pm Hz^-1/2 above (lisainstrument 2.3.0).
    """
    force = 2.4e-15 * np.sqrt(1 + (0.4e-3 / f) ** 2)
    read_out = np.hypot(6.35e-12, 2**0.5 * 1.42e-12) * np.sqrt(1 + (2e-3 / f) ** 4)
    return np.asarray(np.hypot(2**0.5 * force, (2 * np.pi * f) ** 2 * read_out))


@one_blas_thread
def expected_lisa_fit(plan: Sequence[PlannedLisaExperiment], settings: Settings) -> Fit:
    """Return the joint fit to expect; its estimates are the true values.

    Raises
    ------
    InputError
        If there is no experiment, or a setting has no meaning for LISA.
    NoiselessError
        If a run has no noise.
    FitError
        If the fit would come to nothing.
    """
    check_settings(settings)
    plan = [p for p in plan if p.experiment.name not in settings.exclude]
    if not plan:
        raise InputError("no sysid run takes part in the joint fit, expected at least one")
    experiments = [p.experiment for p in plan]
    names = fitted_names(experiments)
    constraints.check(settings.parameters, names, "fit.parameters")
    return fit_of(expected_result(plan, names, settings), names, experiments)


def expected_result(
    plan: Sequence[PlannedLisaExperiment], names: Sequence[str], settings: Settings
) -> IRLSResult:
    """Return the end of the iteration of the fit to expect, for the named parameters."""
    truth = {name: value for p in plan for name, value in p.truth.items()}
    parameters = [replace(LISA[name], value=truth.get(name, LISA[name].value)) for name in names]
    theta = np.array([p.value for p in parameters])
    assert settings.estimator != "flscov"  # see `check_settings`
    weighings = [
        _ExpectedComponent(p, equation, theta, settings.estimator)
        for p in plan
        for equation in _equations(p, names)
    ]
    of_fit = constraints.of_fit(settings.parameters, dict(zip(names, names, strict=True)))
    return iterate(weighings, parameters, convergence=expected_fit.RULE, settings=of_fit)


def _equations(planned: PlannedLisaExperiment, names: Sequence[str]) -> list[lisa_dynamics.Equation]:
    D = lisa_dynamics.equations(planned.experiment.sysid.channels, names)
    arms: Mapping[int, lisa_dynamics.Component] = {1: "I_1", 2: "I_2"}
    return [*D, *(replace(D[0], component=arms[j]) for j in planned.arms)]


class _ExpectedComponent:
    """Makes the block of a component at the true parameters."""

    converged = True

    def __init__(
        self,
        planned: PlannedLisaExperiment,
        equation: lisa_dynamics.Equation,
        theta: Array,
        likelihood: Likelihood,
    ) -> None:
        self.name = planned.experiment.name
        run, tau = planned.experiment.sysid, lisa_dynamics.delays(equation.parameters, theta)
        terms, c = component(run, equation, tau), equation.coefficients(theta, tau)
        if equation.component[0] == "I":
            S = arm_asd(terms.f) ** 2
            arm = -terms.columns[:, 1:] @ c[1:]  # X_j'' of a run without noise
            terms = replace(terms, columns=np.column_stack([arm, terms.columns[:, 1:]]))
        else:
            S = _residual_psd(planned, equation, c, tau)(terms.f)
        self._block = _block(terms, S, equation, likelihood)

    def block(self, _: Array, __: Array, ___: int) -> expected_run.CompressedRun:
        """As that of `fit.fitting.weighings.Weighing`."""
        return self._block


def _block(
    terms: Spectra, S: Array, equation: lisa_dynamics.Equation, likelihood: Likelihood
) -> expected_run.CompressedRun:
    U, _ = whitened_run.whiten(terms, S)
    weights, share = expected_weights(likelihood, terms.f), np.eye(len(equation.parameters))
    run = whitened_run.WhitenedRun(terms.tau, U, weights, terms.window, share, equation=equation)
    return expected_run.compress(run)


def _residual_psd(
    planned: PlannedLisaExperiment, equation: lisa_dynamics.Equation, c: Array, tau: tuple[float, float]
) -> Callable[[Array], Array]:
    """Return the PSD of the residual as a function of frequency."""
    f = frequency_responses.frequencies(planned.experiment.sysid.telemetry)
    names, responses = _responses(planned, tau, f)
    T = np.einsum("bkc,k->bc", responses, equation.basis @ c)
    S = np.einsum("bi,bij,bj->b", T.conj(), planned.cross_spectra(names, f), T).real
    if not np.all(S > 0):
        raise expected_fit.NoiselessError(planned.experiment.sysid.telemetry.run)
    spline = scipy.interpolate.CubicSpline(np.log(f), np.log(S))
    return lambda f: np.asarray(np.exp(spline(np.log(f))), dtype=np.float64)


def _responses(
    planned: PlannedLisaExperiment, tau: tuple[float, float], f: Array
) -> tuple[list[str], NDArray[np.complex128]]:
    """Return the C channels of D, and the responses of the K `COLUMNS` to them, shape (B, K, C)."""
    telemetry = planned.experiment.sysid.telemetry
    names = [name for name in lisa_dynamics.CHANNELS if name in telemetry.channels]

    def columns_of(time: Array, channels: Mapping[str, Array]) -> Array:
        run = replace(telemetry, time=time, channels=channels)
        return lisa_dynamics.columns(lisa_dynamics.channels(run), tau)

    return names, frequency_responses.impulse_responses(columns_of, telemetry.fs, names, f)
