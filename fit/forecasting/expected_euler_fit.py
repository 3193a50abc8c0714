"""The Euler fit to expect before there are data: sigmas of delta_phi and delta_eta.

All that the fit takes from a noise run are sums of products of columns over bins (`inertial`). On average
these are sums of the cross-spectra of the columns, which follow from those of the channels. Of the
centrifugal term there is what is linear about the steady turn, with the rate that the torques give; the star
tracker, in charge below 25 uHz, is left out. Everything else is as in the fit: band, window, weights, weak
priors, torque noise, errors of the calibration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.crosstalk import euler_fit, torque_noise
from fit.findings import Finding
from fit.fitting import Convergence, constraints, iterate
from fit.forecasting.expected_fit import CrossSpectra, noiseless
from fit.forecasting.expected_run import CompressedRun
from fit.forecasting.frequency_responses import GRID, responses
from fit.model import RunChannels, dynamics, dynamics_of, rotation, separation
from fit.model import inertial_forces as forces
from fit.results import Fit
from fit.settings import ParameterSettings
from fit.spacecraft import PATHFINDER
from fit.spectra import windowing
from fit.telemetry import Telemetry, inertial_period
from fit.whitening import weights, whitened_run

if TYPE_CHECKING:
    import lmfit

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

RATE = 1.0  # Hz, far above the band
MAX_SIGMA = 1.0  # rad, from which an angle is indeterminable
#: When an expected fit ends: a move of a thousandth of a sigma.
RULE = Convergence(
    max_iterations=50, tolerance=1e-3, max_move=1e-3, warm_up=-1, moving="expected angles still move"
)
UNDETERMINED = Finding(
    "indeterminable",
    "the spacecraft hardly turns: its noise runs do not determine both delta_phi and delta_eta",
    parameters=euler_fit.NAMES,
)
_FITTED = slice(1, 1 + len(euler_fit.PARAMETERS))  # columns, behind that of Delta g
_DIFFERENCE = slice(_FITTED.stop, _FITTED.stop + len(rotation.AXES))
_CALIBRATION_ERROR = slice(_DIFFERENCE.stop, None)


@dataclass(frozen=True)
class PlannedNoiseRun:
    """A noise run that has not been flown.

    Attributes
    ----------
    run : Telemetry
        The run; of its channels only the names count, and the number of their samples.
    cross_spectra : callable
        As that of `expected_fit.PlannedExperiment`.
    Omega : tuple of float
        Steady rates about the two `rotation.AXES` [rad/s].
    """

    run: Telemetry
    cross_spectra: CrossSpectra
    Omega: tuple[float, float]


def expected_periods(
    noise_runs: Sequence[PlannedNoiseRun],
    joint: Fit,
    parameters: Mapping[str, ParameterSettings] | None = None,
) -> dict[str, Fit]:
    """Return the Euler fit to expect of every inertial period.

    Parameters
    ----------
    noise_runs : sequence of PlannedNoiseRun
        Noise runs; those that take part in no Euler fit do not count.
    joint : Fit
        The joint fit to expect.
    parameters : mapping of str to ParameterSettings, optional
        Constraints of parameters, the angles of a period among them.

    Raises
    ------
    InputError
        If the user names angles of a period that no run belongs to.
    FitError
        If a fit would come to nothing.
    """
    periods: dict[str, list[PlannedNoiseRun]] = {}
    for noise_run in noise_runs:
        if euler_fit.takes_part(noise_run.run):
            periods.setdefault(inertial_period(noise_run.run), []).append(noise_run)
    angles = {name: constraint for name, constraint in (parameters or {}).items() if euler_fit.is_angle(name)}
    constraints.check(angles, euler_fit.names([noise_run.run for noise_run in noise_runs]), "fit.parameters")
    return {
        period: _expected(
            [_ExpectedWeighing(noise_run, joint) for noise_run in runs],
            euler_fit.params_of_period(angles, period),
        )
        for period, runs in periods.items()
    }


def _expected(runs: Sequence["_ExpectedWeighing"], params: "lmfit.Parameters") -> Fit:
    outcome = iterate(runs, euler_fit.PARAMETERS, params, RULE, weak_priors=euler_fit.weak_priors)
    theta, covariance, is_noise = torque_noise.bias_corrected(outcome, runs[0].correlation)
    size = len(euler_fit.NAMES)
    angles, covariance = outcome.estimates(dict(enumerate(euler_fit.NAMES)), theta, covariance)
    determined = [i for i, estimate in enumerate(angles.values()) if estimate.sigma < MAX_SIGMA]
    dof = sum(2 * run.bins for run in runs) - size
    lacking = {warning.message: warning for run in runs for warning in run.warnings}
    return Fit(
        parameters={n: e for n, e in angles.items() if e.sigma < MAX_SIGMA},
        covariance_matrix=covariance[np.ix_(determined, determined)],
        chi2=float(dof),
        dof=dof,
        converged=True,
        warnings=(
            *lacking.values(),
            *([euler_fit.TORQUE_NOISE] if is_noise else []),
            *([UNDETERMINED] if len(determined) < size else []),
        ),
    )


@dataclass(frozen=True)
class _ExpectedRotation(CompressedRun, whitened_run.LinearRun):
    """A whitened run of the Euler fit of which only its expected sums over bins are left.

    Attributes
    ----------
    difference : ndarray, shape (B, 2, 2)
        Expected power of half of what the test masses disagree on.
    calibration_error : ndarray, shape (P, K)
        Products of the columns with what 1 sigma of the calibration adds to Delta g.
    spread : float
        What the window adds to the scatter of sums over bins.
    """

    difference: Array = field(kw_only=True)
    calibration_error: Array = field(kw_only=True)
    spread: float = field(kw_only=True)

    def torque_noise(self, theta: Array) -> tuple[Array, Array]:
        """As that of `torque_noise.NoisyRotation`."""
        of_theta = self.difference @ theta[: len(euler_fit.NAMES)]
        total = of_theta @ theta[: len(euler_fit.NAMES)]
        # fourth moments of complex Gaussian numbers, of which the real parts of the products count
        products = 3 * np.einsum("bi,bj->ij", of_theta, of_theta) + np.einsum(
            "bij,b->ij", self.difference, total
        )
        return np.asarray(self.difference.sum(axis=0)), np.asarray(self.spread * products / 4)

    def calibration_moments(self) -> Array:
        """As that of `torque_noise.NoisyRotation`."""
        return self.calibration_error


class _ExpectedWeighing:
    """The cross-spectra of the columns of a run, those of `inertial` in their order.

    Attributes
    ----------
    name : str
        Of the run.
    bins : int
        Of the band.
    correlation : ndarray, shape (K, K)
        Of the parameters of the calibration.
    warnings : tuple of Finding
        What the calibration lacks.
    """

    def __init__(self, noise_run: PlannedNoiseRun, joint: Fit) -> None:
        of_run = dynamics_of(noise_run.run, joint)
        n = round(noise_run.run.duration * RATE)
        self._empty_spectra = windowing.transform(np.zeros((n, 1)), np.ones(n, dtype=bool), RATE).band(
            *euler_fit.BAND
        )
        self.name, self.bins = noise_run.run.run, self._empty_spectra.f.size
        self._spread = windowing.variance_factor(self._empty_spectra.window)
        self.correlation, self.warnings = of_run.correlation, of_run.warnings
        low, high = euler_fit.BAND
        self._f = np.geomspace(0.99 * low, 1.01 * high, round(GRID * np.log10(high / low)))
        names, rows = _rows(noise_run, of_run.theta, of_run.share, self._f)
        noise = noise_run.cross_spectra(names, self._f)
        power = np.einsum("bki,bij,blj->bkl", rows.conj(), noise, rows, optimize=True).real
        if not np.all(power[:, 0, 0] > 0):
            raise noiseless(noise_run.run.run)
        self._power = power
        self._of_bins = self._spline(power)

    converged = True

    def block(self, theta: Array, _: Array, __: int) -> "_ExpectedRotation":
        """Return the run at the estimate theta, shape (P,), as `euler_fit` whitens it."""
        c = np.array([1.0, *theta])
        fitted = slice(0, c.size)
        residual = np.einsum("k,bkl,l->b", c, self._power[:, fitted, fitted], c)
        S = np.exp(self._spline(np.log(residual)))
        weight = 2 * whitened_run.whiten(self._empty_spectra, S)[1] / S
        products = np.einsum("b,bkl->kl", weight, self._of_bins)
        H = products[fitted, fitted]
        difference = weight[:, None, None] * self._of_bins[:, _DIFFERENCE, _DIFFERENCE]
        none = weights("gaussian", np.zeros(0), np.zeros(0))
        return _ExpectedRotation(
            tau=self._empty_spectra.tau,
            columns=np.zeros((0, c.size), np.complex128),
            weights=none,
            window=None,
            parameter_map=np.eye(theta.size),
            R=whitened_run.qr_factor(whitened_run.matrix_sqrt(H)),
            H=H,
            M=H * self._spread,
            bins=self.bins,
            difference=difference,
            calibration_error=products[_FITTED, _CALIBRATION_ERROR],
            spread=self._spread,
        )

    def _spline(self, values: Array) -> Array:
        spline = scipy.interpolate.CubicSpline(np.log(self._f), values)
        return np.asarray(spline(np.log(self._empty_spectra.f)))


def _rows(
    noise_run: PlannedNoiseRun, theta: Array, share: Array, f: Array
) -> tuple[tuple[str, ...], Spectrum]:
    """Return names of C channels, and the frequency responses of the columns to them, shape (B, K, C)."""
    run = noise_run.run
    sources = rotation.sources(run)
    assert sources is not None
    d, omega = separation(run.x_axis), 2 * np.pi * f
    kinds = ("N_{}_1", "N_{}_2", "o_{}_1", "o_{}_12")
    of_axes = (kind.format(axis) for axis in rotation.AXES for kind in kinds)
    names = (*dynamics.CHANNELS, *of_axes)
    channel = {name: row.astype(np.complex128) for name, row in zip(names, np.eye(len(names)), strict=True)}
    tau = dynamics.delays(theta)
    still = np.zeros(1)
    valid = np.ones(1, dtype=bool)
    series = dict.fromkeys(dynamics.CHANNELS, still)
    at_rest = RunChannels(RATE, still, valid, 0, series, dynamics.PARAMETERS)
    terms = np.zeros((f.size, len(dynamics.COLUMNS), len(names)), dtype=np.complex128)
    terms[:, :, : len(dynamics.CHANNELS)] = responses(PATHFINDER, at_rest, tau, dynamics.CHANNELS, f)

    def angular(acceleration: Spectrum, angle: Spectrum, axis: str) -> Spectrum:
        """Return the row of dOmega over channels from those of torque and angle."""
        return np.asarray(acceleration + np.multiply.outer(omega**2 - sources.omega2[axis], angle))

    turned, lengths, difference = [], [], []
    omega2_2 = theta[dynamics.PARAMETERS.index("omega2_2")]
    for axis in rotation.AXES:
        N_1, N_2 = (channel[f"N_{axis}_{j}"] / sources.inertia[axis] for j in (1, 2))
        o_1, o_12 = channel[f"o_{axis}_1"], channel[f"o_{axis}_12"]
        turned.append(angular((N_1 + N_2) / 2, o_1 + o_12 / 2, axis))
        difference.append(angular((N_1 - N_2) / 2, -o_12 / 2, axis))
        lengths.append(np.multiply.outer(omega2_2 - omega**2, o_1 + o_12 / 2))
    factors = forces.euler(np.ones((1, len(rotation.AXES))), d)[0]
    euler, disagreed = (np.stack(x, axis=1) * factors[:, None] for x in (turned, difference))
    rate = np.stack(turned, axis=1) / (1j * omega[:, None, None])
    g_Omega = -2 * d * np.einsum("k,bkc->bc", noise_run.Omega, rate)
    delta_g = np.einsum("k,bkc->bc", dynamics.coefficients(theta, tau), terms) + g_Omega
    calibration_error = np.einsum("kp,bkc->bpc", dynamics.gradient(theta, tau) @ share, terms)
    columns = (delta_g[:, None], euler, np.stack(lengths, axis=1), disagreed, calibration_error)
    return names, np.concatenate(columns, axis=1)
