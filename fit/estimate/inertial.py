"""Euler fit: delta_phi and delta_eta of a period, from all its long noise runs at once.

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
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.estimate import linear
from fit.estimate.irls import HARMLESS, MAX_ITERATIONS, TOLERANCE, Held, Outcome, Rule, iterate
from fit.estimate.likelihood import weights
from fit.estimate.runs import check_left, smooth_noise
from fit.model import dynamics, dynamics_of, inertial, rate, rotation
from fit.paper import cross_talk_parameter, misalignments
from fit.results import Estimate, Fit
from fit.signal import NoiseModel, Spectrum, spectra
from fit.telemetry import Telemetry
from fit.warnings import FitWarning

Array = NDArray[np.float64]

NAMES = ("delta_phi", "delta_eta")
PARAMETERS = (*misalignments("none flown"), *map(cross_talk_parameter, ("b_1", "b_2")))
BAND = (30e-6, 2e-3)  # Hz
SHORTEST = 43200.0  # s: below, Omega and the PSD rest on a handful of bins


def takes_part(run: Telemetry) -> bool:
    """Tell whether a run is a noise run, long enough, with torques about both axes."""
    torques = all(any(f"N_{axis}_{j}" in run.channels for j in (1, 2)) for axis in rotation.AXES)
    return run.kind == "noise" and run.duration >= SHORTEST * 0.995 and torques


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
    weighings = [_Turning(run, joint) for run in runs]
    rule = Rule(
        MAX_ITERATIONS, TOLERANCE, HARMLESS, windowed=True, moving=f"{' and '.join(NAMES)} still move"
    )
    outcome = iterate(weighings, PARAMETERS, _held, rule)
    solution = outcome.solution
    calibration = _of_calibration(outcome, weighings[0].correlation)
    covariance = (solution.covariance + calibration)[:2, :2]
    sigma = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(sigma) & (sigma > 0)):
        raise FitError("the sigma of delta_phi or delta_eta is not a positive number")
    pairs = zip(NAMES, solution.theta[:2], sigma, strict=True)
    return Fit(
        parameters={name: Estimate(float(value), float(s), "rad") for name, value, s in pairs},
        covariance=covariance,
        chi2=solution.chi2,
        dof=sum(block.size for block in outcome.blocks) - len(NAMES),
        converged=outcome.converged,
        warnings=_warnings([(w.run, warning) for w in weighings for warning in w.warnings]),
        masked_samples=sum(w.missing for w in weighings),
    )


@dataclass(frozen=True)
class _Rotation(linear.Straight):
    """A whitened run; its columns: Delta g_x + g_Omega, the two of `inertial.euler`, phibar'' and etabar''.

    Attributes
    ----------
    uncertain : ndarray of complex, shape (B, K)
        What 1 sigma of each parameter of the calibration adds to the first column.
    """

    uncertain: Spectrum = field(kw_only=True)


class _Turning:
    """Weighs a run by the smooth PSD of its own residual.

    Attributes
    ----------
    run : str
        Its name.
    correlation : ndarray, shape (K, K)
        Of the parameters of the calibration.
    missing : int
        Number of missing samples.
    warnings : list of FitWarning
        What is lacking.
    """

    settled = True

    def __init__(self, run: Telemetry, joint: Fit) -> None:
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
        turned = delta_g_x + inertial.g_Omega(Omega)
        columns = np.column_stack([turned, inertial.euler(motion.dOmega), motion.swing, uncertain])
        # Constants and ramps are projected out below; large ones would cost digits.
        whole = spectra.transform(columns - columns.mean(axis=0), terms.valid & motion.valid, terms.fs)
        check_left(run, whole.window, "missing samples in read-outs, torques or angles")
        self._terms = whole.band(*BAND)
        self._model: NoiseModel | None = None
        self.run, self.correlation, self.missing = run.run, of_run.correlation, channels.missing
        self.warnings = [*found.warnings, *slow.warnings, *of_run.warnings]

    def block(self, theta: Array, covariance: Array, _: int) -> _Rotation:
        """Return the run weighed at the estimate theta of that covariance."""
        c, share = np.array([1.0, *theta]), np.eye(theta.size)
        taken = np.eye(c.size, theta.size, k=-1), covariance
        if self._model is None:
            self._model = smooth_noise(self._terms, c, taken, None)
        self._model = smooth_noise(self._terms, c, taken, self._model)
        terms = self._terms
        U, _left = linear.whiten(terms, self._model.expected(terms.f))
        even, fitted = weights("gaussian", terms.f, np.ones(terms.f.size)), U[:, : c.size]
        other = U[:, c.size :]
        return _Rotation(terms.tau, fitted, even, terms.window, None, share, terms.first, uncertain=other)


def _held(blocks: Sequence[linear.Block], theta: Array, _: Array) -> Held:
    """Hold b_1 and b_2 by their weak priors about zero."""
    width = np.array([p.prior_sigma for p in PARAMETERS])
    prior = linear.Prior(np.zeros(theta.size), np.diag(1 / width)[len(NAMES) :])
    H = linear.information(blocks, theta) + prior.rows.T @ prior.rows
    scale = np.sqrt(np.diag(H))
    if not np.all(scale > 0) or np.linalg.cond(H / np.outer(scale, scale)) > 1e12:
        raise FitError("the torques tell no rotation about phi and eta apart; a run that turns is needed")
    return Held(prior, np.zeros(theta.size, dtype=bool), np.empty((0, theta.size)), None)


def _of_calibration(outcome: Outcome, correlation: Array) -> Array:
    """Return the covariance that the errors of the calibration make, shape (4, 4)."""
    blocks, theta = outcome.blocks, outcome.solution.theta
    width = np.array([p.prior_sigma for p in PARAMETERS])
    inverse = linear.curvature_covariance(linear.information(blocks, theta), outcome.prior, width)
    # One calibration serves all runs, so its errors add up; that of delta_ifo counts for nothing here.
    shift = inverse @ np.sum(
        [(b.columns[:, 1:].conj().T @ b.uncertain).real for b in blocks if isinstance(b, _Rotation)], axis=0
    )
    return np.asarray(shift @ correlation @ shift.T)


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
