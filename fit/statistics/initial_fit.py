"""Initial fit of a single run by linear least squares, without parameters shared among experiments."""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from fit.model import Equation
from fit.spectra import NoiseModel, Spectra, Spectrum, fit_noise
from fit.whitening import Experiment, ResidualSpectrum, Run, fit_residual_noise, whitened_run

Array = NDArray[np.float64]

MAX_DELAY_OFFSET = 0.3  # s from the delays of the flight, up to which an expansion about these will do
MAX_DELAY = 60.0  # s: what seems to be later is no delay
ACTING_GAINS = (0.5, 2.0)  # between these a command acts, and its delay is determined
MIN_GAIN = 50.0  # of chi2, by other delays: these add no freedom
DELAY_TOLERANCE = 0.05  # s, to which it need be known
MAX_ITERATIONS = 8


@dataclass(frozen=True)
class InitialFit:
    """An initial fit.

    Attributes
    ----------
    tau : tuple of float
        Delays [s] about which to expand the run: those of the flight, unless far others fit better. What lies
        seconds off is no linear delay at the fastest tones: it would pass for glitches.
    c : tuple of ndarray, shape (K,)
        Least-squares coefficients of the columns of each equation, weighted by the level it has in flight.
    """

    tau: tuple[float, float]
    c: tuple[Array, ...]


def initial_fit(run: Run) -> InitialFit:
    """Return the initial fit of a run."""
    if run not in _CACHE:
        _CACHE[run] = _initial_fit(run)
    return _CACHE[run]


_CACHE: WeakKeyDictionary[Run, InitialFit] = WeakKeyDictionary()


def _initial_fit(run: Run) -> InitialFit:
    nominal = run.spacecraft.delays
    pairs = [(force.start, force.start + 1) for force in run.spacecraft.forces]
    smallest, tau = np.inf, nominal
    for _ in range(MAX_ITERATIONS):
        terms = run.spectra(tau)
        scale = np.sqrt(2 / run.spacecraft.level(terms.f))[:, None]
        whitened = [_whitened(run, equation, terms) for equation in run.equations]
        c = tuple(lstsq_coefficients(U) for U in whitened)
        chi2 = sum(float(np.sum(np.abs(U @ x) ** 2)) for U, x in zip(whitened, c, strict=True))
        n_bins = sum(len(U) for U in whitened)
        if tau == nominal:
            fit, smallest = InitialFit(tau, c), chi2 / (1 + MIN_GAIN / (2 * n_bins))
        elif chi2 < smallest:
            fit, smallest = InitialFit(tau, c), chi2
        else:
            break
        # of the columns of the run, a row for each equation
        of_run = np.array([e.of_columns(x) for e, x in zip(run.equations, c, strict=True)])
        gains = np.linalg.norm(of_run, axis=0)
        delays = (
            t - of_run[:, df] @ of_run[:, f] / gains[f] ** 2
            if ACTING_GAINS[0] < gains[f] < ACTING_GAINS[1]
            else t
            for t, (f, df) in zip(tau, pairs, strict=True)
        )
        tau_1, tau_2 = (float(np.clip(t, -MAX_DELAY, MAX_DELAY)) for t in delays)
        offsets = tau_1 - tau[0], tau_2 - tau[1]
        converged = max(map(abs, offsets)) < (MAX_DELAY_OFFSET if tau == nominal else DELAY_TOLERANCE)
        # what an expansion leaves out of commands at delays that are off by so much
        angle = 2 * np.pi * terms.f
        omitted = sum(
            np.sum(np.abs(terms.columns[:, f] * scale[:, 0] * gains[f] * (t * angle) ** 2 / 2) ** 2)
            for t, (f, _) in zip(offsets, pairs, strict=True)
        )
        if converged or omitted < chi2 / (2 * n_bins):  # too little to gain
            break
        tau = tau_1, tau_2
    return fit


def _whitened(run: Run, equation: Equation, terms: Spectra) -> Spectrum:
    """Return the columns of an equation, whitened by the level that it has in flight."""
    return whitened_run.whiten(equation.spectra(terms), run.spacecraft.level(terms.f))[0]


def lstsq_coefficients(U: Spectrum) -> Array:
    """Return the least-squares coefficients of whitened columns, shape (P,), the first of them 1."""
    rows = whitened_run.as_real(U)
    norms = np.linalg.norm(rows, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    R = whitened_run.qr_factor(rows / scale)  # as good as the rows, and far smaller
    rounding = len(rows) * np.finfo(np.float64).eps
    c = np.linalg.lstsq(R[:, 1:], -R[:, 0] * scale[0], rcond=rounding)[0] / scale[1:]
    return np.array([1.0, *c])


def initial_noise_psd(experiment: Experiment, index: int = 0) -> NoiseModel:
    """Return the PSD of an equation of the noise run at nominal parameters, whatever the sysid run contains.

    Without a noise run it is that of the residual of the sysid run.
    """
    run = experiment.noise or experiment.sysid
    spacecraft, equation = run.spacecraft, run.equations[index]
    terms = equation.spectra(run.spectra(spacecraft.delays))
    if experiment.noise:
        nominal = {p.name: p.value for p in spacecraft.parameters(run.telemetry, equation.parameters)}
        c = equation.coefficients(equation.parameters_of(nominal), spacecraft.delays)
        return fit_residual_noise(ResidualSpectrum(terms, c), None)
    c = lstsq_coefficients(whitened_run.whiten(terms, np.ones(terms.f.size))[0])
    model = fit_noise(terms.f, *ResidualSpectrum(terms, c).power(None))
    c = lstsq_coefficients(whitened_run.whiten(terms, model(terms.f))[0])
    return fit_noise(terms.f, *ResidualSpectrum(terms, c).power(model))
