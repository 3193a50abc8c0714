"""Euler fit: delta_phi and delta_eta of a period, from all its long noise runs at once.

The fit minimises the noise of Delta g between 30 uHz and 2 mHz: each run windowed as a whole, constant and
ramp projected out, weighted by a smooth PSD of its own residual until nothing moves; chi^2 is then one per
degree of freedom whatever the fit is worth.

Of delta_g_SC the terms b_1 phibar'' + b_2 etabar'' count even here: near the bandwidth of their suspension
the test masses lag behind the spacecraft, which would shift the angles by some 3 %, two sigma in nine days.
These lengths are in the read-out o_12, so that omega2_2 multiplies them too, which is 0.24 % of delta_eta.
They are fitted along, which widens the sigmas by 5 %. What a calibration knows of b_1 and b_2 is no help: at
the frequencies where it finds them, the Euler force has their shape (see `fit.deltag`).

Noise in dOmega attenuates what least squares finds by the share of its power in that of dOmega: torque noise
on a test mass of 1.5e-12 rad s^-2 Hz^-0.5 by 0.1 %, of 1e-11 delta_phi by 6 %, 16 % with one test mass. Two
test masses measure the same rotation with noises of their own, by which that is corrected (`torque_noise`).
An error of the torque gain scales both angles, one of lambda_2 likewise (1e-4: nothing).

The centrifugal term counts as it follows from the rotation. To see whether it is there, and of which sign,
its coefficient is estimated too, along with all others (`centrifugal`); the angles are those without it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fit.crosstalk import centrifugal, long_glitches, torque_noise
from fit.errors import FitError
from fit.findings import Finding
from fit.fitting import NullSpace, Prior, constraint_test, constraints, iterate
from fit.model import Dynamics, angular_rate, dynamics, dynamics_of, inertial_forces, rotation
from fit.parameters import Parameter, cross_talk_parameter, misalignments
from fit.results import Estimate, Fit
from fit.settings import ParameterSettings
from fit.spacecraft import spacecraft_of
from fit.spectra import NoiseModel, Spectrum, windowing
from fit.telemetry import Telemetry, common_x_axis, inertial_period
from fit.whitening import (
    ResidualSpectrum,
    check_coverage,
    fit_residual_noise,
    weights,
    whitened_run,
)

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]

NAMES = ("delta_phi", "delta_eta")
LEVER_ARM = 4e-4  # m, what b_1 and b_2 may have to compensate: a misalignment of a milliradian
_LENGTHS = [replace(cross_talk_parameter(name), prior_sigma=LEVER_ARM) for name in ("b_1", "b_2")]
PARAMETERS = (*misalignments("none flown"), *_LENGTHS)
CENTRIFUGAL = 1 + len(PARAMETERS)  # the column behind those of Delta g and `PARAMETERS`: g_Omega
BAND = (30e-6, 2e-3)  # Hz
PER_CYCLE = 50.0  # instants in a cycle of the highest frequency, at which glitches are made
MIN_DURATION = 43200.0  # s: below, Omega and the PSD depend on a handful of bins
TORQUE_NOISE = Finding(
    "torque_noise",
    "the two test masses disagree on more than half of dOmega: noise of the torques attenuates delta_phi and "
    "delta_eta by an unknown amount",
    parameters=NAMES,
)


def takes_part(run: Telemetry) -> bool:
    """Return whether a run is a noise run of Delta g, long enough, with torques about both axes."""
    torques = all(any(f"N_{axis}_{j}" in run.channels for j in (1, 2)) for axis in rotation.AXES)
    return (
        run.kind == "noise"
        and run.duration >= MIN_DURATION * 0.995
        and torques
        and spacecraft_of(run).has_inertial
    )


def names(runs: Sequence[Telemetry]) -> list[str]:
    """Return the names of the angles of every period that runs belong to, the period at their end."""
    periods = dict.fromkeys(inertial_period(run) for run in runs if takes_part(run))
    return [f"{name}_{period}" for period in periods for name in NAMES]


def angles(runs: Sequence[Telemetry]) -> list[Parameter]:
    """Return the angles of every period that runs belong to, in the order of `names`."""
    of_period = dict(zip(NAMES, PARAMETERS, strict=False))
    return [replace(of_period[name.rpartition("_")[0]], name=name) for name in names(runs)]


def is_angle(name: str) -> bool:
    """Return whether a name is that of an angle of a period, as a user names it."""
    return name.startswith(tuple(f"{angle}_" for angle in NAMES))


def params_of_period(
    stated: Mapping[str, ParameterSettings] | None, period: str, parameters: Sequence[Parameter] = PARAMETERS
) -> lmfit.Parameters:
    """Return the parameters of a period as lmfit has them, with what is stated of its angles."""
    return constraints.params(parameters, stated, {f"{name}_{period}": name for name in NAMES})


def fit_period(
    runs: Sequence[Telemetry],
    joint: Fit,
    period: str = "0",
    stated: Mapping[str, ParameterSettings] | None = None,
    n_periods: int = 1,
) -> Fit:
    """Fit one inertial period.

    Parameters
    ----------
    runs : sequence of Telemetry
        Those of the period that `takes_part` accepts.
    joint : Fit
        The calibration of the dynamics.
    period : str
        Its name.
    stated : mapping of str to ParameterSettings, optional
        Constraints of parameters, the angles of the period among them.
    n_periods : int
        Number of periods of the campaign, in each of which the frame is tested.

    Raises
    ------
    InputError
        If an attribute or a quaternion is not what it should be, or if runs state different frames.
    FitError
        If the iteration does not settle, or a sigma is no positive number.
    """
    x_axis = common_x_axis(runs)
    weighings = [_EulerWeighing(run, joint) for run in runs]
    outcome = iterate(weighings, PARAMETERS, params_of_period(stated, period), weak_priors=weak_priors)
    g_Omega = _centrifugal(weighings, period, stated)
    solution = outcome.solution
    theta, covariance, is_noise = torque_noise.bias_corrected(outcome, weighings[0].correlation)
    estimates, covariance = outcome.estimates(dict(enumerate(NAMES)), theta, covariance)
    return Fit(
        parameters=estimates,
        covariance_matrix=covariance,
        chi2=solution.chi2,
        dof=sum(block.size for block in outcome.whitened_runs) - len(NAMES),
        converged=outcome.converged,
        warnings=(
            *_warnings([(w.name, warning) for w in weighings for warning in w.warnings]),
            *([TORQUE_NOISE] if is_noise else []),
            *(centrifugal.frame_warnings(g_Omega, x_axis, n_periods)),
            *constraint_test.refit_unconstrained(outcome).warnings,
        ),
        masked_samples=sum(w.missing for w in weighings),
        centrifugal=g_Omega,
        solved=outcome.solved,
    )


@dataclass(frozen=True)
class _WhitenedRotation(whitened_run.LinearRun):
    """A whitened run; columns: Delta g_x + g_Omega, the two of `inertial_forces.euler`, those of b_1 and b_2.

    Where the coefficient of g_Omega is left free, that is the last column.

    Attributes
    ----------
    calibration_error : ndarray of complex, shape (B, K)
        What 1 sigma of each parameter of the calibration adds to the first column.
    disagreement : ndarray of complex, shape (B, 2)
        Half of what the test masses disagree on the two columns of `inertial_forces.euler`.
    """

    calibration_error: Spectrum = field(kw_only=True)
    disagreement: Spectrum = field(kw_only=True)

    def torque_noise(self, theta: Array) -> tuple[Array, Array]:
        """As that of `torque_noise.NoisyRotation`."""
        assert self.window is not None
        noise = (self.disagreement.conj().T @ self.disagreement).real
        power = (self.disagreement.conj() * (self.disagreement @ theta[: len(NAMES)])[:, None]).real
        # half: its square has twice the mean that the square of its mean has
        return noise, windowing.variance_factor(self.window) * power.T @ power / 2

    def calibration_moments(self) -> Array:
        """As that of `torque_noise.NoisyRotation`."""
        return np.asarray((self.columns[:, 1:].conj().T @ self.calibration_error).real)


def _columns(
    run: Telemetry, sources: rotation.Sources, of_run: Dynamics
) -> tuple[dynamics.Columns, Spectrum, int, Sequence[Finding]]:
    """Make the columns of a run; of what they are made of nothing stays in memory.

    Returns
    -------
    columns : dynamics.Columns
        Without their mean.
    calibration_error : ndarray of complex, shape (B, K)
        See `_WhitenedRotation`: spectra, since the series would take most of the memory.
    missing : int
        Number of missing samples.
    warnings : sequence of Finding
        About the rate.
    """
    motion = rotation.motion(run, sources)
    slow = angular_rate.slow_rate(run.path, [motion], motion.time[0], motion.time[-1])
    d = inertial_forces.separation(run.x_axis)
    columns = np.empty((motion.time.size, CENTRIFUGAL + 1 + len(NAMES)))
    columns[:, 1:3] = inertial_forces.euler(motion.dOmega, d)
    # b_1 and b_2 are lengths in the read-out o_12, which the stiffness multiplies as well
    omega2_2 = of_run.theta[dynamics.PARAMETERS.index("omega2_2")]
    columns[:, 3:CENTRIFUGAL] = motion.swing + omega2_2 * motion.angle
    columns[:, CENTRIFUGAL] = inertial_forces.g_Omega(
        angular_rate.rate(motion, slow, angular_rate.Integral(motion.fs)), d
    )
    valid = motion.valid
    del motion
    columns[:, CENTRIFUGAL + 1 :] = inertial_forces.euler(rotation.half_difference(run, sources), d)
    channels = dynamics.channels(run, motion=False)
    terms = dynamics.columns(channels, dynamics.delays(of_run.theta))
    columns[:, 0] = terms.values @ dynamics.coefficients(of_run.theta, terms.tau) + columns[:, CENTRIFUGAL]
    valid &= terms.valid
    for values in (columns, terms.values):
        # Constants and ramps are projected out later; large ones would cost digits.
        values -= values.mean(axis=0)
    spread = dynamics.gradient(of_run.theta, terms.tau) @ of_run.share
    calibration_error = windowing.transform(terms.values, valid, terms.fs, band=BAND).columns @ spread
    terms_of_fit = replace(terms, names=(), values=columns, valid=valid)
    return terms_of_fit, calibration_error, channels.missing, slow.warnings


class _EulerWeighing:
    """Weighs a run by the smooth PSD of its own residual.

    Attributes
    ----------
    name : str
        Of the run.
    correlation : ndarray, shape (K, K)
        Of the parameters of the calibration.
    missing : int
        Number of missing samples.
    warnings : list of Finding
        What is lacking.
    """

    converged = True

    def __init__(self, run: Telemetry, joint: Fit) -> None:
        sources = rotation.sources(run)
        assert sources is not None
        of_run = dynamics_of(run, joint)
        terms, calibration_error, self.missing, warnings = _columns(run, sources, of_run)
        glitches = long_glitches.find_glitches(terms.values[:, :CENTRIFUGAL], terms.valid, terms.time, BAND)
        spectra = windowing.transform(terms.values, terms.valid, terms.fs, band=BAND)
        check_coverage(run, spectra.window, "missing samples in read-outs, torques or angles")
        window, fs = windowing.resample_window(spectra.window, terms.fs, PER_CYCLE * BAND[1])
        instants = terms.time[0] + np.arange(window.size) / fs
        shapes = long_glitches.columns(glitches or (), instants, fs, BAND[1])
        shaped = [windowing.windowed_spectra(shapes, window, fs, spectra.bins)] if glitches else []
        self._terms = replace(
            spectra,
            columns=np.hstack([spectra.columns, calibration_error]),
            nuisance=np.hstack([spectra.nuisance, *shaped]),
        )
        self._model: NoiseModel | None = None
        self.name, self.correlation = run.run, of_run.correlation
        self.warnings = [*sources.warnings, *warnings, *of_run.warnings]
        if warning := long_glitches.glitch_warning(run.run, glitches, run.duration):
            self.warnings.append(warning)

    def block(self, theta: Array, covariance: Array, _: int) -> _WhitenedRotation:
        """Return the run weighed at the estimate theta of that covariance."""
        c, share = np.array([1.0, *theta]), np.eye(theta.size)
        gradient = np.eye(c.size, theta.size, k=-1), covariance
        terms, residual = self._terms, ResidualSpectrum(self._terms, c, gradient)
        self._model = fit_residual_noise(residual, self._model or fit_residual_noise(residual, None))
        U, _fraction = whitened_run.whiten(terms, self._model.expected(terms.f))
        even, fitted = weights("gaussian", terms.f, np.ones(terms.f.size)), U[:, : c.size]
        disagreement, calibration_error = np.split(U[:, CENTRIFUGAL + 1 :], [len(NAMES)], axis=1)
        common = (terms.tau, fitted, even, terms.window, share, terms.first)
        return _WhitenedRotation(*common, calibration_error=calibration_error, disagreement=disagreement)


def weak_priors(information: Array, free: Array) -> tuple[NullSpace, dict[int, Prior]]:
    """Return the weak priors of all but the angles, about zero."""
    size = len(information)
    nuisance = [*PARAMETERS, centrifugal.EXCESS][len(NAMES) : size]
    H = information + np.diag([0.0] * len(NAMES) + [p.prior_sigma**-2 for p in nuisance])
    H = free.T @ H @ free
    scale = np.sqrt(np.diag(H))
    if not np.all(scale > 0) or np.linalg.cond(H / np.outer(scale, scale)) > 1e12:
        raise FitError("the torques do not separate rotation about phi and eta; a run that turns is needed")
    priors = {i: Prior(0.0, p.prior_sigma) for i, p in enumerate(nuisance, len(NAMES))}
    return NullSpace(np.zeros(size, dtype=bool), np.empty((0, size))), priors


def _centrifugal(
    weighings: Sequence[_EulerWeighing], period: str, stated: Mapping[str, ParameterSettings] | None
) -> Estimate:
    """Estimate the coefficient of g_Omega, all else left free as well."""
    parameters = (*PARAMETERS, centrifugal.EXCESS)
    params = params_of_period(stated, period, parameters)
    outcome = iterate(weighings, parameters, params, weak_priors=weak_priors)
    correlation = weighings[0].correlation
    covariance = outcome.solution.covariance + torque_noise.calibration_covariance(outcome, correlation)
    return Estimate(1 + float(outcome.solution.theta[-1]), float(np.sqrt(covariance[-1, -1])), "1")


def _warnings(warnings_of_runs: Sequence[tuple[str, Finding]]) -> tuple[Finding, ...]:
    """Return the warnings of several runs, each sentence once, and that which holds for all data."""
    runs: dict[tuple[str, str], list[str]] = {}
    unique: dict[tuple[str, str], Finding] = {}
    for run, warning in warnings_of_runs:
        key = warning.run, warning.message
        runs.setdefault(key, []).append(run)
        unique[key] = warning
    of_runs = [replace(w, message=f"{', '.join(runs[key])}: {w.message}") for key, w in unique.items()]
    message = (
        "a force along x that the torques on the test masses leak (actuation cross-talk) has the shape of "
        "the Euler force and counts as part of delta_phi and delta_eta; these data cannot separate the two"
    )
    return Finding("degenerate_with_actuation_crosstalk", message, parameters=NAMES), *of_runs
