"""What the Euler fit will know of delta_phi and delta_eta, told before there are data.

All that the fit takes from a noise run are sums of products of columns over bins (`inertial`). On average
these are sums of the cross-spectra of the columns, which follow from those of the channels. Of the
centrifugal term there is what is linear about the steady turn, with the rate that the torques tell; the star
tracker, in charge below 25 uHz, is left out. Everything else is as in the fit: band, window, weights, weak
priors, torque noise, errors of the calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.crosstalk import euler_fit
from fit.errors import FitError
from fit.forecasting.expected_fit import GRID, CrossSpectra, NoiselessError, responses
from fit.model import dynamics, dynamics_of, rotation, separation
from fit.model import inertial as forces
from fit.results import Estimate, Fit
from fit.spectra import windowing
from fit.telemetry import Telemetry, inertial_period
from fit.warnings import FitWarning
from fit.whitening import whitened_run

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

RATE = 1.0  # Hz, far above the band
LARGEST = 1.0  # rad, from which on a sigma tells nothing of an angle
MOST, SETTLED = 50, 1e-3  # iterations, and the move in sigma at which they end
_FITTED = slice(1, 1 + len(euler_fit.PARAMETERS))  # columns, behind that of Delta g
_APART = slice(_FITTED.stop, _FITTED.stop + len(rotation.AXES))
_UNCERTAIN = slice(_APART.stop, None)


@dataclass(frozen=True)
class PlannedTurn:
    """A noise run that has not been flown.

    Attributes
    ----------
    run : Telemetry
        The run; of its channels only the names count, and the number of their samples.
    cross_spectra : callable
        As that of `forecast.Planned`.
    Omega : tuple of float
        Steady rates about the two `rotation.AXES` [rad/s].
    """

    run: Telemetry
    cross_spectra: CrossSpectra
    Omega: tuple[float, float]


def expected_periods(planned: Sequence[PlannedTurn], joint: Fit) -> dict[str, Fit]:
    """Return the Euler fit to expect of every inertial period.

    Parameters
    ----------
    planned : sequence of PlannedTurn
        Noise runs; those that take part in no Euler fit do not count.
    joint : Fit
        The joint fit to expect.

    Raises
    ------
    FitError
        If a fit would come to nothing.
    """
    periods: dict[str, list[PlannedTurn]] = {}
    for one in planned:
        if euler_fit.takes_part(one.run):
            periods.setdefault(inertial_period(one.run), []).append(one)
    return {name: _expected([_Turn(one, joint) for one in runs]) for name, runs in periods.items()}


def _expected(runs: Sequence["_Turn"]) -> Fit:
    width = np.array([p.prior_sigma for p in euler_fit.PARAMETERS])
    theta, size = np.zeros(width.size), len(euler_fit.NAMES)
    prior = whitened_run.Prior(theta, np.diag(1 / width)[size:])
    known = prior.rows.T @ prior.rows
    for _ in range(MOST):
        sums = [run.sums(theta) for run in runs]
        H = np.sum([each[_FITTED, _FITTED] for each in sums], axis=0)
        inverse = whitened_run.curvature_covariance(H, prior, width)
        before, theta = theta, -inverse @ np.sum([each[_FITTED, 0] for each in sums], axis=0)
        if np.all(np.abs(theta - before) <= SETTLED * np.sqrt(np.diag(inverse))):
            break
    else:
        raise FitError(f"{' and '.join(euler_fit.NAMES)} still move after {MOST} iterations of the forecast")
    scores = known + np.sum(
        [s[_FITTED, _FITTED] * run.spread for s, run in zip(sums, runs, strict=True)], axis=0
    )
    noise, happens = np.zeros((2, width.size, width.size))
    noise[:size, :size] = np.sum([each[_APART, _APART] for each in sums], axis=0)
    happens[:size, :size] = np.sum([run.happens(theta) for run in runs], axis=0)
    theta, covariance, drowned = euler_fit.freed(
        theta, inverse @ scores @ inverse, H + known, noise, happens, width
    )
    shift = inverse @ np.sum([each[_FITTED, _UNCERTAIN] for each in sums], axis=0)
    covariance = (covariance + shift @ runs[0].correlation @ shift.T)[:size, :size]
    sigma = np.sqrt(np.diag(covariance))
    told = np.flatnonzero(sigma < LARGEST)
    dof = sum(2 * run.bins for run in runs) - size
    lacking = {warning.message: warning for run in runs for warning in run.warnings}
    return Fit(
        parameters={euler_fit.NAMES[i]: Estimate(float(theta[i]), float(sigma[i]), "rad") for i in told},
        covariance=covariance[np.ix_(told, told)],
        chi2=float(dof),
        dof=dof,
        converged=True,
        warnings=(
            *lacking.values(),
            *([euler_fit.drowned()] if drowned else []),
            *([_still()] if told.size < size else []),
        ),
    )


def _still() -> FitWarning:
    message = "the spacecraft hardly turns: its noise runs do not tell both delta_phi and delta_eta"
    return FitWarning("indeterminable", euler_fit.NAMES, message)


class _Turn:
    """The cross-spectra of the columns of a run, those of `inertial` in their order.

    Attributes
    ----------
    spread : float
        Of its window, see `spectra.spread`.
    bins : int
        Of the band.
    correlation : ndarray, shape (K, K)
        Of the parameters of the calibration.
    warnings : tuple of FitWarning
        What the calibration lacks.
    """

    def __init__(self, planned: PlannedTurn, joint: Fit) -> None:
        of_run = dynamics_of(planned.run, joint)
        n = round(planned.run.duration * RATE)
        self._still = windowing.transform(np.zeros((n, 1)), np.ones(n, dtype=bool), RATE).band(
            *euler_fit.BAND
        )
        self.spread, self.bins = windowing.spread(self._still.window), self._still.f.size
        self.correlation, self.warnings = of_run.correlation, of_run.warnings
        low, high = euler_fit.BAND
        self._f = np.geomspace(0.99 * low, 1.01 * high, round(GRID * np.log10(high / low)))
        names, rows = _rows(planned, of_run.theta, of_run.share, self._f)
        noise = planned.cross_spectra(names, self._f)
        power = np.einsum("bki,bij,blj->bkl", rows.conj(), noise, rows, optimize=True).real
        if not np.all(power[:, 0, 0] > 0):
            raise NoiselessError(planned.run.run)
        self._power = power
        self._of_bins = self._spline(power)
        self._weight = np.zeros(self.bins)

    def sums(self, theta: Array) -> Array:
        """Return the sums of products of whitened columns over bins, shape (K, K), at the estimate theta."""
        c = np.array([1.0, *theta])
        fitted = slice(0, c.size)
        residual = np.einsum("k,bkl,l->b", c, self._power[:, fitted, fitted], c)
        S = np.exp(self._spline(np.log(residual)))
        self._weight = 2 * whitened_run.whiten(self._still, S)[1] / S
        return np.asarray(np.einsum("b,bkl->kl", self._weight, self._of_bins))

    def happens(self, theta: Array) -> Array:
        """Return what the power of what test masses disagree on happens to add, see `inertial.freed`."""
        apart = self._weight[:, None, None] * self._of_bins[:, _APART, _APART]
        of_theta = apart @ theta[: len(euler_fit.NAMES)]
        total = of_theta @ theta[: len(euler_fit.NAMES)]
        # fourth moments of complex Gaussian numbers, of which the real parts of the products count
        products = 3 * np.einsum("bi,bj->ij", of_theta, of_theta) + np.einsum("bij,b->ij", apart, total)
        return np.asarray(self.spread * products / 4)

    def _spline(self, values: Array) -> Array:
        found = scipy.interpolate.CubicSpline(np.log(self._f), values)(np.log(self._still.f))
        return np.asarray(found)


def _rows(planned: PlannedTurn, theta: Array, share: Array, f: Array) -> tuple[tuple[str, ...], Spectrum]:
    """Return names of C channels, and the frequency responses of the columns to them, shape (B, K, C)."""
    run = planned.run
    found = rotation.sources(run)
    assert found is not None
    d, omega = separation(run.x_axis), 2 * np.pi * f
    of_axes = (f"{kind}_{j}" for axis in rotation.AXES for kind, j in _told_by(axis))
    names = (*dynamics.CHANNELS, *of_axes)
    channel = {name: row.astype(np.complex128) for name, row in zip(names, np.eye(len(names)), strict=True)}
    tau = dynamics.delays(theta)
    still = np.zeros(1)
    at_rest = dynamics.Channels(RATE, still, still, still, still, still, {}, np.ones(1, dtype=bool), 0)
    terms = np.zeros((f.size, len(dynamics.COLUMNS), len(names)), dtype=np.complex128)
    terms[:, :, : len(dynamics.CHANNELS)] = responses(at_rest, tau, dynamics.CHANNELS, f)

    def angular(acceleration: Spectrum, angle: Spectrum, axis: str) -> Spectrum:
        """Return what torque and angle tell of dOmega, of their rows over channels."""
        return np.asarray(acceleration + np.multiply.outer(omega**2 - found.omega2[axis], angle))

    turned, lengths, apart = [], [], []
    omega2_2 = theta[dynamics.PARAMETERS.index("omega2_2")]
    for axis in rotation.AXES:
        N_1, N_2 = (channel[f"N_{axis}_{j}"] / found.inertia[axis] for j in (1, 2))
        o_1, o_12 = channel[f"o_{axis}_1"], channel[f"o_{axis}_12"]
        turned.append(angular((N_1 + N_2) / 2, o_1 + o_12 / 2, axis))
        apart.append(angular((N_1 - N_2) / 2, -o_12 / 2, axis))
        lengths.append(np.multiply.outer(omega2_2 - omega**2, o_1 + o_12 / 2))
    factors = forces.euler(np.ones((1, len(rotation.AXES))), d)[0]
    euler, disagreed = (np.stack(x, axis=1) * factors[:, None] for x in (turned, apart))
    rate = np.stack(turned, axis=1) / (1j * omega[:, None, None])
    g_Omega = -2 * d * np.einsum("k,bkc->bc", planned.Omega, rate)
    delta_g = np.einsum("k,bkc->bc", dynamics.coefficients(theta, tau), terms) + g_Omega
    uncertain = np.einsum("kp,bkc->bpc", dynamics.gradient(theta, tau) @ share, terms)
    columns = (delta_g[:, None], euler, np.stack(lengths, axis=1), disagreed, uncertain)
    return names, np.concatenate(columns, axis=1)


def _told_by(axis: str) -> tuple[tuple[str, int], ...]:
    return ((f"N_{axis}", 1), (f"N_{axis}", 2), (f"o_{axis}", 1), (f"o_{axis}", 12))
