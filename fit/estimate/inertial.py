"""Euler fit: delta_phi and delta_eta of a period, from all its long noise runs at once (eq. g_dOmega).

    Delta g = Delta g_x + g_Omega + g_dOmega + delta_g_SC,
    g_Omega = -(Omega_phi^2 + Omega_eta^2) d,    g_dOmega = d (-dOmega_phi delta_phi + dOmega_eta delta_eta)

What is made least is the noise Delta g between 30 uHz and 2 mHz: each run windowed as a whole, constant and
ramp projected out, weighted by a smooth PSD of its own residual until nothing moves; chi^2 is then one per
degree of freedom whatever the fit is worth.

Of delta_g_SC the terms b_1 phibar'' + b_2 etabar'' count even here: near the bandwidth of their suspension
the test masses lag behind the spacecraft, which would shift the angles by some 3 %, two sigma in nine days.
They are fitted along, which widens the sigmas by 5 %. What a calibration knows of b_1 and b_2 is no help: at
the frequencies where it finds them, the Euler force has their shape (see `fit.deltag`).

Noise in dOmega attenuates: with torque noise q on a test mass (averaged over two: q / sqrt 2) the angles come
out too small by the share of its power in that of dOmega, 0.1 % at q = 1.5e-12 rad s^-2 Hz^-0.5 and 16 % of
delta_phi at 1e-11. An error of the torque gain scales both angles, one of lambda_2 likewise (1e-4: nothing).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.estimate import linear
from fit.estimate.irls import HARMLESS, MAX_ITERATIONS, SETTLED, TOLERANCE
from fit.estimate.runs import LEAST
from fit.model import dynamics, dynamics_of, rate, rotation
from fit.paper import cross_talk_parameter
from fit.results import Estimate, Fit
from fit.signal import NoiseModel, fit_noise, spectra
from fit.telemetry import Telemetry
from fit.warnings import FitWarning

Array = NDArray[np.float64]

BASELINE = 0.376  # m, from test mass 1 to test mass 2
NAMES = ("delta_phi", "delta_eta")
CROSS_TALK = ("b_1", "b_2")
BAND = (30e-6, 2e-3)  # Hz
SHORTEST = 43200.0  # s: below, Omega and the PSD rest on a handful of bins


def g_Omega(Omega: Array) -> Array:
    """Return the centrifugal term [m s^-2] (eq. centrifugal) of rates [rad/s] of shape (N, 2)."""
    return np.asarray(-BASELINE * np.sum(Omega**2, axis=1))


def euler(dOmega: Array) -> Array:
    """Return g_dOmega per unit of delta_phi and delta_eta (eq. g_dOmega) [m s^-2], shape (N, 2)."""
    return dOmega * (-BASELINE, BASELINE)


def takes_part(run: Telemetry) -> bool:
    """Tell whether a run is a noise run, long enough, with torques about both axes."""
    torques = all(any(f"N_{axis}_{j}" in run.channels for j in (1, 2)) for axis in rotation.AXES)
    return run.kind == "noise" and run.duration >= SHORTEST * 0.995 and torques


@dataclass(frozen=True)
class _Stretch:
    """Spectra of one run in the band.

    Attributes
    ----------
    terms : spectra.Spectra
        Columns: Delta g_x + g_Omega, the two of `euler`, phibar'' and etabar'', and what 1 sigma of each
        parameter of the calibration adds to the first.
    first : int
        Number of the first bin.
    correlation : ndarray, shape (K, K)
        Of the parameters of the calibration.
    missing : int
        Number of missing samples.
    """

    terms: spectra.Spectra
    first: int
    correlation: Array
    missing: int


def fit_period(runs: Sequence[Telemetry], joint: Fit) -> Fit:
    """Fit one inertial period.

    Parameters
    ----------
    runs : sequence of Telemetry
        Those of the period that `takes_part` accepts.
    joint : Fit
        The calibration of the dynamics.

    Raises
    ------
    InputError
        If an attribute or a quaternion is not what it should be.
    FitError
        If the iteration does not settle.
    """
    stretches, told = [], []
    for run in runs:
        stretch, warnings = _stretch(run, joint)
        stretches.append(stretch)
        told += [(run.run, warning) for warning in warnings]
    masked = sum(stretch.missing for stretch in stretches)
    theta, covariance = np.zeros(4), np.zeros((4, 4))
    models = [_noise(stretch, theta, covariance, None) for stretch in stretches]
    for iteration in range(MAX_ITERATIONS):
        models = [_noise(s, theta, covariance, m) for s, m in zip(stretches, models, strict=True)]
        found = _solve(stretches, models)
        covariance = found.statistical
        moved = float(np.max(np.abs(found.theta - theta) / np.sqrt(np.diag(covariance))))
        if iteration > 1 and moved < (HARMLESS if iteration == MAX_ITERATIONS - 1 else TOLERANCE):
            estimates, covariance = _estimates(found)
            converged = moved < TOLERANCE
            return Fit(estimates, covariance, found.chi2, found.dof, converged, _warnings(told), masked)
        step = 1.0 if iteration < SETTLED else 0.5  # lest weights and angles swing against each other
        theta = theta + step * (found.theta - theta)
    raise FitError(
        f"delta_phi and delta_eta still move by {moved:.2g} sigma after {MAX_ITERATIONS} iterations"
    )


def _stretch(run: Telemetry, joint: Fit) -> tuple[_Stretch, list[FitWarning]]:
    found = rotation.sources(run)
    assert found is not None
    of_run = dynamics_of(run, joint)
    channels = dynamics.channels(run, motion=False)
    terms = dynamics.columns(channels, dynamics.delays(of_run.theta))
    motion = rotation.motion(run, found)
    slow = rate.slow_rate(run.path, [motion], motion.time[0], motion.time[-1])
    Omega = rate.rate(motion, slow, rate.Integral(motion.fs))
    delta_g_x = terms.values @ dynamics.coefficients(of_run.theta, terms.tau)
    uncertain = terms.values @ (dynamics.gradient(of_run.theta, terms.tau) @ of_run.share)
    columns = np.column_stack([delta_g_x + g_Omega(Omega), euler(motion.dOmega), motion.swing, uncertain])
    # Constants and ramps are projected out below; large ones would cost digits.
    whole = spectra.transform(columns - columns.mean(axis=0), terms.valid & motion.valid, terms.fs)
    if np.mean(whole.window**2) < LEAST:
        raise InputError(
            f"{run.path}: missing samples in read-outs, torques or angles lie so widely scattered that "
            f"masking leaves less than {100 * LEAST:g} % of the run, expected longer stretches"
        )
    band = (whole.f >= BAND[0]) & (whole.f <= BAND[1])
    inside = replace(whole, f=whole.f[band], columns=whole.columns[band], nuisance=whole.nuisance[band])
    first = int(np.argmax(band)) + 1
    stretch = _Stretch(inside, first, of_run.correlation, channels.missing)
    return stretch, [*found.warnings, *slow.warnings, *of_run.warnings]


def _noise(stretch: _Stretch, theta: Array, covariance: Array, previous: NoiseModel | None) -> NoiseModel:
    """Fit a smooth PSD to the residual; what the fit has taken out of it is given back."""
    S = previous(stretch.terms.f) if previous else np.ones(stretch.terms.f.size)
    U, left = linear.whiten(stretch.terms, S)
    residual = U[:, 0] + U[:, 1:5] @ theta
    taken = np.einsum("bi,ij,bj->b", U[:, 1:5], covariance, U[:, 1:5].conj()).real / 2
    model = fit_noise(stretch.terms.f, np.abs(residual) ** 2 * S / 2, np.maximum(left - taken, 0))
    return model if previous else _noise(stretch, theta, covariance, model)


@dataclass(frozen=True)
class _Solution:
    """The minimum of chi^2.

    Attributes
    ----------
    theta : ndarray, shape (4,)
        delta_phi, delta_eta, b_1 and b_2.
    statistical, calibration : ndarray, shape (4, 4)
        Their covariance due to the noise, and due to the calibration.
    chi2 : float
        At the minimum.
    dof : int
        Data less parameters.
    """

    theta: Array
    statistical: Array
    calibration: Array
    chi2: float
    dof: int


def _solve(stretches: Sequence[_Stretch], models: Sequence[NoiseModel]) -> _Solution:
    """Solve the weighted normal equations; b_1 and b_2 have their weak priors about zero."""
    H, M, right = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(4)
    whitened = []
    for stretch, model in zip(stretches, models, strict=True):
        U, _ = linear.whiten(stretch.terms, model.expected(stretch.terms.f))
        A, w = U[:, 1:5], stretch.terms.window
        H += (A.conj().T @ A).real
        right -= (A.conj().T @ U[:, 0]).real
        # The window makes neighbouring bins one noise: covariance of the scores, as in linear.Block.
        padded = np.zeros((w.size // 2 + 1, 4), dtype=np.complex128)
        padded[stretch.first : stretch.first + len(A)] = A
        z = scipy.fft.irfft(padded, w.size, axis=0) * (w.size / 2) * w[:, None] * np.sqrt(2 / (w @ w))
        M += z.T @ z
        whitened.append(U)
    known = np.diag([0.0, 0.0, *(1 / cross_talk_parameter(name).prior_sigma ** 2 for name in CROSS_TALK)])
    H += known
    scale = np.sqrt(np.diag(H))
    if not np.all(scale > 0) or np.linalg.cond(H / np.outer(scale, scale)) > 1e12:
        raise FitError("the torques tell no rotation about phi and eta apart; a run that turns is needed")
    inverse = np.linalg.inv(H)
    theta = inverse @ right
    # One calibration serves all runs, so its errors add up; that of delta_ifo counts for nothing here.
    shift = inverse @ sum((U[:, 1:5].conj().T @ U[:, 5:]).real for U in whitened)
    return _Solution(
        theta=theta,
        statistical=inverse @ (M + known) @ inverse,
        calibration=shift @ stretches[0].correlation @ shift.T,
        chi2=sum(float(np.sum(np.abs(U[:, 0] + U[:, 1:5] @ theta) ** 2)) for U in whitened),
        dof=2 * sum(len(U) - 1 for U in whitened) - 2,
    )


def _estimates(found: _Solution) -> tuple[dict[str, Estimate], Array]:
    """Return the estimates and their covariance."""
    covariance = (found.statistical + found.calibration)[:2, :2]
    sigma = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(sigma) & (sigma > 0)):
        raise FitError("the sigma of delta_phi or delta_eta is not a positive number")
    pairs = zip(NAMES, found.theta[:2], sigma, strict=True)
    return {name: Estimate(float(value), float(s), "rad") for name, value, s in pairs}, covariance


def _warnings(told: Sequence[tuple[str, FitWarning]]) -> tuple[FitWarning, ...]:
    """Return what was told of several runs, each sentence once, and what holds for all data."""
    runs: dict[str, list[str]] = {}
    for run, warning in told:
        runs.setdefault(warning.message, []).append(run)
    unique = {warning.message: warning for _, warning in told}
    of_runs = [
        replace(warning, message=f"{', '.join(runs[message])}: {message}")
        for message, warning in unique.items()
    ]
    message = (
        "a force along x that the torques on the test masses leak (actuation cross-talk) has the shape of "
        "the Euler force and counts as part of delta_phi and delta_eta; these data cannot tell the two apart"
    )
    return FitWarning("degenerate_with_actuation_crosstalk", NAMES, message), *of_runs
