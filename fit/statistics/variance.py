"""Variance test of a whitened residual in bands of frequency.

Whitened by the PSD of its noise run, the residual of a fit has unit variance in every band. The power summed
over sets of bins has the covariance

    spread(window) (diag(n) + J C J^T),

with n the expected power of the sets, C the covariance of the knots of log S and J the sums of their
derivatives over the sets. Without a noise run the PSD follows this very residual, and the sign of the second
term is negative. The same covariance serves all tests:

* level: the ratio of the power in a band to that of the noise run (`VarianceTable.log_ratio`);
* chi^2: the ratio of all bins together;
* read-out noise: the level of o_1 at frequencies without injection.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.false_alarms import sigma_limit
from fit.fitting import IRLSResult
from fit.results import Diagnostics
from fit.spectra import NoiseModel, fit_noise, windowing
from fit.whitening import Experiment, noise_model, whitened_run

Array = NDArray[np.float64]

BAND_EDGES = np.array([0.0, 1e-3, 3e-3, 1e-2, 3e-2, 1.0])  # Hz
N_BANDS = BAND_EDGES.size - 1
TESTS_PER_RUN = N_BANDS + 2  # level of every band, chi^2, read-out noise
MIN_BINS = 8  # of a band
MAX_DEPARTURE = 7.5  # of chi^2, in standard deviations of as many numbers: 5 with window and error of the PSD
MAX_POWER_RATIO = 100.0  # beyond, the noise run does not represent the noise at all


def n_tests(n_runs: int) -> int:
    """Return the number of variance tests of a campaign."""
    return TESTS_PER_RUN * n_runs + N_BANDS


@dataclass(frozen=True)
class WhitenedResidual:
    """The whitened residual of a run.

    Attributes
    ----------
    f : ndarray, shape (B,)
        Frequencies [Hz].
    z : ndarray of complex, shape (B,)
        Real and imaginary part have variance 1 each if the noise is that of the PSD.
    window : ndarray, shape (N,)
        Of the run.
    noise : NoiseModel
        The PSD.
    independent : bool
        Whether the PSD is that of another run.
    retained : ndarray, shape (B,)
        Expected power, from 0 to 1: less than 1 where the fit has absorbed noise.
    n_projected : int
        Number of real numbers projected out.
    """

    f: Array
    z: NDArray[np.complex128]
    window: Array
    noise: NoiseModel
    independent: bool = True
    retained: Array = field(default_factory=lambda: np.ones(1))
    n_projected: int = 2

    @property
    def power(self) -> Array:
        """Power of every bin, 1 expected, shape (B,)."""
        return np.asarray(np.abs(self.z) ** 2 / 2)

    @property
    def expected_power(self) -> Array:
        """Power to expect of every bin, shape (B,)."""
        return np.asarray(self.retained * np.ones(self.f.size))

    def power_covariance(self, sets: NDArray[np.bool_]) -> Array:
        """Return the covariance of the power summed over disjoint sets of bins, shape (S, B): (S, S)."""
        basis, expected = self.noise.basis(self.f), sets * self.retained
        psd = self.noise.covariance
        if not self.independent:
            psd = np.asarray(-np.linalg.inv(basis.products(self.expected_power)), dtype=np.float64)
        J = basis.summed(expected)
        return np.asarray(
            windowing.variance_factor(self.window) * (np.diag(expected.sum(axis=1)) + J @ psd @ J.T),
            dtype=np.float64,
        )

    def log_ratios(self, sets: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return log(power / expected power) of disjoint sets of bins, and its standard deviation: (S,) each.

        The PSD is widened by its variance, while the mean of its lognormal error is half of that.
        """
        expected = sets @ self.expected_power
        variance = self.noise.basis(self.f).variance(self.noise.covariance)
        ratio = np.log(sets @ self.power / expected) + sets @ variance / sets.sum(axis=1) / 2
        return ratio, np.sqrt(np.diag(self.power_covariance(sets))) / expected


@dataclass(frozen=True)
class VarianceTable:
    """Variances of a whitened residual, by frequency band.

    Attributes
    ----------
    bands : ndarray of int, shape (B,)
        Numbers of the bands that have enough bins.
    log_ratio, sigma : ndarray, shape (B,)
        Logarithm of the variance of each band over that of the noise run, and its standard deviation.
    """

    bands: NDArray[np.intp]
    log_ratio: Array
    sigma: Array

    @property
    def z_score(self) -> Array:
        """Departure of the levels from those of the noise run in standard deviations, shape (B,)."""
        return np.asarray(self.log_ratio / self.sigma)

    def mismatched(self, n_runs: int) -> NDArray[np.bool_]:
        """Return in which bands the level is not that of the noise run, shape (B,)."""
        return np.asarray(np.abs(self.z_score) > sigma_limit(n_tests(n_runs)))


def whitened_residuals(
    experiment: Experiment, result: IRLSResult, index: int = 0
) -> tuple[WhitenedResidual, ...]:
    """Return the whitened residuals of a run in a fit, one of each equation; see `whitened_residual`."""
    n = len(result.whitened_runs[index].blocks)
    return tuple(whitened_residual(experiment, result, index, k) for k in range(n))


def whitened_residual(
    experiment: Experiment, result: IRLSResult, index: int = 0, equation: int = 0
) -> WhitenedResidual:
    """Return the whitened residual of an equation of a run in a fit.

    Parameters
    ----------
    experiment : Experiment
        The run.
    result : IRLSResult
        Of a fit of one or more runs.
    index : int
        Number of the run in that fit.
    equation : int
        Number of the equation.

    Raises
    ------
    FitError
        If the run was not weighed by a PSD, and its noise has none.
    """
    run, solution = result.whitened_runs[index].blocks[equation], result.solution
    theta, covariance = solution.theta, solution.covariance
    if run.noise is None or run.window is None:  # flscov weighs a run by its own periodogram
        of_run, share = run.parameter_map @ covariance @ run.parameter_map.T, run.parameter_map
        noise = noise_model(experiment, share @ theta, of_run, None, equation)
        terms = run.equation.spectra(experiment.sysid.spectra(run.tau))
        run = whitened_run.whiten_run(terms, noise, share, equation=run.equation)
    assert run.noise is not None and run.window is not None and run.f is not None
    rows = run.gradient(theta).T @ whitened_run.as_real(run.columns).T
    absorbed = ((covariance @ rows) * rows).sum(axis=0).reshape(-1, 2).sum(axis=1) / 2
    z = run.columns @ run.coefficients(theta)
    if experiment.noise is None:  # a PSD that has followed this residual makes it neither larger nor smaller
        z = z * np.exp(run.noise.basis(run.f).variance(run.noise.covariance) / 2)
    return WhitenedResidual(
        run.f,
        z,
        run.window,
        run.noise,
        experiment.noise is not None,
        np.clip(1 - absorbed, 0.05, 1),
        run.n_projected,
    )


def variance_table(residual: WhitenedResidual) -> VarianceTable:
    """Return the variances of a residual by band.

    Bands with fewer than `MIN_BINS` bins are left out, and so are bins below the lowest frequency of the
    noise run, where its PSD is an extrapolation.
    """
    f = residual.f
    known = np.log(f) > residual.noise.knots[0] - 1e-9
    sets = np.array([(f > low) & (f <= high) & known for low, high in pairwise(BAND_EDGES)])
    bands = np.flatnonzero(sets.sum(axis=1) >= MIN_BINS)
    return VarianceTable(bands, *residual.log_ratios(sets[bands]))


def chi2_ratio(result: IRLSResult, *indices: int) -> tuple[float, float]:
    """Return chi^2 / dof of some runs of a fit, all by default, and its standard deviation.

    Marginalised levels of the noise are applied.
    """
    of_fit = result.whitened_runs
    runs = [block for k in indices or range(len(of_fit)) for block in of_fit[k].blocks]
    residuals = [run.root_level @ run.coefficients(result.solution.theta) for run in runs]
    ratio = sum(float(r @ r) for r in residuals) / sum(run.size for run in runs)
    if not indices:
        ratio = result.solution.chi2 / result.solution.dof
    variance = 0.0
    for run in runs:
        n = len(run.columns)
        variance += n * (1.0 if run.window is None else windowing.variance_factor(run.window))
        if run.noise is not None and run.f is not None:
            J = run.noise.basis(run.f).summed(np.ones(n))
            variance += float(J @ run.noise.covariance @ J)
    n_numbers = sum(len(run.columns) for run in runs)
    return ratio, math.sqrt(variance) / n_numbers if n_numbers else math.inf  # of a forecast, no numbers


def is_misfit(ratio: float, sigma: float, n_runs: int) -> bool:
    """Return whether chi^2 / dof differs from 1 significantly."""
    return is_excess(ratio, sigma, n_runs) or is_excess(2 - ratio, sigma, n_runs)


def is_excess(ratio: float, sigma: float, n_runs: int) -> bool:
    """Return whether a ratio of powers exceeds 1 significantly."""
    return ratio - 1 > sigma_limit(n_tests(n_runs)) * sigma


def is_plausible(ratio: float, dof: int) -> bool:
    """Return whether the sigmas may be valid at this chi^2 / dof.

    An excess E of chi^2 may be an effect that moves a parameter by the root of E in sigmas: the limit is no
    fixed ratio but what chance makes.
    """
    return abs(math.log(max(ratio, 1e-300))) < MAX_DEPARTURE * math.sqrt(2 / max(dof, 1))


def is_broadband(residual: WhitenedResidual, bands: NDArray[np.intp], n_runs: int) -> bool:
    """Return whether the excess in some bands is noise, which fills them, and not lines or spurious signals.

    The logarithm of exponentially distributed power over its mean has mean -0.577 and variance pi^2 / 6;
    lines raise the smooth PSD of the residual and leave most bins below it.
    """
    power, retained = residual.power, residual.expected_power
    try:
        psd = fit_noise(residual.f, power, retained)(residual.f)
    except FitError:
        return False
    deficit = -np.log(np.maximum(power, 1e-300) / (retained * psd)) - np.euler_gamma
    limit = sigma_limit(n_tests(n_runs))
    for band in bands:
        bins = (residual.f > BAND_EDGES[band]) & (residual.f <= BAND_EDGES[band + 1])
        variance = windowing.variance_factor(residual.window) * np.count_nonzero(bins) * np.pi**2 / 6
        if deficit[bins].sum() > limit * math.sqrt(variance):
            return False
    return True


def diagnose(experiment: Experiment, result: IRLSResult) -> Diagnostics:
    """Return the level of the residual of a fit of one experiment.

    Raises
    ------
    FitError
        If the noise has no PSD.
    """
    residuals = whitened_residuals(experiment, result)
    return diagnostics(residuals, int(np.count_nonzero(~result.undetermined)))


def diagnostics(residuals: Sequence[WhitenedResidual], n_absorbed: int) -> Diagnostics:
    """Return the level of residuals from which a fit has absorbed `n_absorbed` numbers."""
    power = sum(2 * float(np.sum(residual.power)) for residual in residuals)
    n_free = sum(2 * residual.f.size - residual.n_projected for residual in residuals) - n_absorbed
    n_bins = sum(residual.f.size for residual in residuals)
    variance = sum(float(r.power_covariance(np.ones((1, r.f.size), dtype=bool))[0, 0]) for r in residuals)
    return Diagnostics(chi2_red=power / n_free, chi2_red_sigma=math.sqrt(max(variance, 0.0)) / n_bins)
