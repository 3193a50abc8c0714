"""Initial fit of a single run by linear least squares, without parameters shared among experiments."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.model import dynamics
from fit.parameters import DELAYS, experiment_parameters
from fit.spectra import NoiseModel, Spectrum, fit_noise
from fit.whitening import Experiment, ResidualSpectrum, Run, fit_residual_noise, whitened_run

MAX_DELAY_OFFSET = 0.3  # s from the delays of the flight, up to which an expansion about these will do
MAX_DELAY = 60.0  # s: what seems to be later is no delay
ACTING_GAINS = (0.5, 2.0)  # between these a command acts, and its delay is determined
MIN_GAIN = 50.0  # of chi2, by other delays: these add no freedom
DELAY_TOLERANCE = 0.05  # s, to which it need be known
MAX_ITERATIONS = 8
_FORCES = tuple((dynamics.COLUMNS.index(f"f_{j}"), dynamics.COLUMNS.index(f"df_{j}")) for j in (1, 2))


@dataclass(frozen=True)
class InitialFit:
    """An initial fit.

    Attributes
    ----------
    tau : tuple of float
        Delays [s] about which to expand the run: those of the flight, unless far others fit better. What lies
        seconds off is no linear delay at the fastest tones: it would pass for glitches.
    c : ndarray, shape (P,)
        Least-squares coefficients of its columns, weighted by `flight_psd`.
    """

    tau: tuple[float, float]
    c: NDArray[np.float64]


def initial_fit(run: Run) -> InitialFit:
    """Return the initial fit of a run."""
    if run not in _CACHE:
        _CACHE[run] = _initial_fit(run)
    return _CACHE[run]


_CACHE: WeakKeyDictionary[Run, InitialFit] = WeakKeyDictionary()


def has_spectra(experiment: Experiment) -> bool:
    """Return whether the gaps of both runs of an experiment leave enough for spectra."""
    try:
        for run in (experiment.sysid, experiment.noise):
            if run:
                initial_fit(run)
    except InputError:
        return False
    return True


def _initial_fit(run: Run) -> InitialFit:
    smallest, tau = np.inf, DELAYS
    for _ in range(MAX_ITERATIONS):
        terms = run.spectra(tau)
        U = whitened_run.whiten(terms, flight_psd(terms.f))[0]
        c = lstsq_coefficients(U)
        chi2 = float(np.sum(np.abs(U @ c) ** 2))
        if tau == DELAYS:
            fit, smallest = InitialFit(tau, c), chi2 / (1 + MIN_GAIN / (2 * len(U)))
        elif chi2 < smallest:
            fit, smallest = InitialFit(tau, c), chi2
        else:
            break
        acting = [ACTING_GAINS[0] < abs(c[f]) < ACTING_GAINS[1] for f, _ in _FORCES]
        delays = (
            t - c[df] / c[f] if acts else t for t, (f, df), acts in zip(tau, _FORCES, acting, strict=True)
        )
        tau_1, tau_2 = (float(np.clip(t, -MAX_DELAY, MAX_DELAY)) for t in delays)
        offsets = tau_1 - tau[0], tau_2 - tau[1]
        converged = max(map(abs, offsets)) < (MAX_DELAY_OFFSET if tau == DELAYS else DELAY_TOLERANCE)
        noise_power = chi2 / (2 * len(U))
        if converged or _omitted_power(U * c, terms.f, offsets) < noise_power:  # too little to gain
            break
        tau = tau_1, tau_2
    return fit


def _omitted_power(columns: Spectrum, f: NDArray[np.float64], offsets: tuple[float, float]) -> float:
    """Return the power of what an expansion leaves out of commands at delays that are off by so much [s]."""
    angle = 2 * np.pi * f
    terms = (np.abs(columns[:, k]) * (t * angle) ** 2 / 2 for t, (k, _) in zip(offsets, _FORCES, strict=True))
    return sum(float(term @ term) for term in terms)


def flight_psd(f: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the PSD that Delta g had in flight, at frequencies [Hz] of shape (B,), 1 at its plateau."""
    return 1 + (1e-3 / f) ** 2 + (f / 0.03) ** 4


def lstsq_coefficients(U: Spectrum) -> NDArray[np.float64]:
    """Return the least-squares coefficients of whitened columns, shape (P,), the first of them 1."""
    rows = whitened_run.as_real(U)
    norms = np.linalg.norm(rows, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    R = whitened_run.qr_factor(rows / scale)  # as good as the rows, and far smaller
    rounding = len(rows) * np.finfo(np.float64).eps
    c = np.linalg.lstsq(R[:, 1:], -R[:, 0] * scale[0], rcond=rounding)[0] / scale[1:]
    return np.array([1.0, *c])


def initial_noise_psd(experiment: Experiment) -> NoiseModel:
    """Return the PSD of the noise run under the dynamics of the flight, whatever the sysid run contains.

    Without a noise run it is that of the residual of the sysid run.
    """
    run = experiment.noise or experiment.sysid
    terms = run.spectra(DELAYS)
    if experiment.noise:
        flight = experiment_parameters(run.telemetry.authority, run.telemetry.alignment_epoch)
        theta = [flight[name].value if name in flight else 0.0 for name in run.channels.parameters]
        return fit_residual_noise(
            ResidualSpectrum(terms, dynamics.coefficients(np.array(theta), DELAYS)), None
        )
    c = lstsq_coefficients(whitened_run.whiten(terms, np.ones(terms.f.size))[0])
    model = fit_noise(terms.f, *ResidualSpectrum(terms, c).power(None))
    c = lstsq_coefficients(whitened_run.whiten(terms, model(terms.f))[0])
    return fit_noise(terms.f, *ResidualSpectrum(terms, c).power(model))
