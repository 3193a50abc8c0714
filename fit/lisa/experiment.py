"""A run of one LISA spacecraft with injections, its noise run, and what weighs the two components of D."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fit.lisa import attenuation
from fit.model import lisa_dynamics
from fit.requirements import STEEP_GAP_TAPER
from fit.spectra import NoiseModel, Spectra, derivatives, windowing
from fit.telemetry import Telemetry
from fit.whitening import (
    Likelihood,
    ResidualSpectrum,
    WhitenedRun,
    check_coverage,
    fit_residual_noise,
    pair_runs,
    whitened_run,
)

Array = NDArray[np.float64]

WARM_UP = 1  # iteration up to which the signal may still be in the residual


@dataclass
class _Latest:
    """Spectra of a run at the delays that were asked for last."""

    spectra: Spectra | None = None


@dataclass(frozen=True, eq=False)
class LisaRun:
    """A run, and the spectra of its `lisa_dynamics.COLUMNS` at any delays.

    Attributes
    ----------
    telemetry : Telemetry
        The run.
    f_max : float
        End of the fitted band [Hz].
    """

    telemetry: Telemetry
    f_max: float = derivatives.F_MAX
    _latest: _Latest = field(default_factory=_Latest, init=False, repr=False)

    @cached_property
    def channels(self) -> lisa_dynamics.Channels:
        """Its channels, low-passed and decimated."""
        return lisa_dynamics.channels(self.telemetry)

    @property
    def n_masked(self) -> int:
        """Number of samples of the file that are missing."""
        return self.channels.missing

    def spectra(self, tau: tuple[float, float]) -> Spectra:
        """Return the spectra with the commands of test masses 1 and 2 delayed by `tau` [s].

        Raises
        ------
        InputError
            If missing samples leave too little of the run.
        """
        latest = self._latest.spectra
        if latest is None or latest.tau != tau:
            run = self.channels
            valid = ~derivatives.dilate_mask(~run.valid)
            band = None if self.f_max >= derivatives.F_MAX else (0.0, self.f_max)
            columns = lisa_dynamics.columns(run, tau)
            latest = windowing.transform(columns, valid, run.fs, tau, band=band, gap_taper=STEEP_GAP_TAPER)
            check_coverage(self.telemetry, latest.window, f"{run.missing} missing samples")
            self._latest.spectra = latest
        return latest


@dataclass(frozen=True, eq=False)
class LisaExperiment:
    """A run with injections and its noise run.

    Attributes
    ----------
    sysid : LisaRun
        With injections.
    noise : LisaRun or None
        Without, None where there is none.
    """

    sysid: LisaRun
    noise: LisaRun | None

    @property
    def name(self) -> str:
        """Name that pairs the two."""
        return self.sysid.telemetry.experiment


def pair(telemetries: Sequence[Telemetry], f_max: float) -> list[LisaExperiment]:
    """Pair each run that has injections with the noise run of the same experiment, where there is one.

    Raises
    ------
    InputError
        If there are two of a kind, or one is too short.
    """
    return [
        LisaExperiment(LisaRun(sysid, f_max), None if noise is None else LisaRun(noise, f_max))
        for sysid, noise in pair_runs(telemetries)
    ]


class ComponentWeighing:
    """Weighs a component of D of one experiment by the smooth PSD of its noise run.

    Parameters
    ----------
    experiment : LisaExperiment
        The runs.
    equation : lisa_dynamics.Equation
        The component.
    parameter_map : ndarray, shape (K, P)
        From the fitted parameters to those of the run.
    likelihood : str
        What the residual is taken to be like.
    """

    converged = True

    def __init__(
        self,
        experiment: LisaExperiment,
        equation: lisa_dynamics.Equation,
        parameter_map: Array,
        likelihood: Likelihood,
    ) -> None:
        self.name = experiment.name
        self._experiment, self._equation = experiment, equation
        self._parameter_map, self._likelihood = parameter_map, likelihood
        self._noise: NoiseModel | None = None

    def block(self, theta: Array, covariance: Array, iteration: int) -> WhitenedRun:
        """Return the component weighed at the estimate theta, shape (P,), of that covariance, (P, P)."""
        of_run = self._parameter_map @ theta
        tau = lisa_dynamics.delays(self._equation.parameters, of_run)
        terms = component(self._experiment.sysid, self._equation, tau)
        c, gradient = self._equation.coefficients(of_run, tau), self._equation.gradient(of_run, tau)
        of_fit = self._parameter_map @ covariance @ self._parameter_map.T
        residual = ResidualSpectrum(terms, c, (gradient, of_fit))
        noise = self._experiment.noise
        noise_terms = None if noise is None else component(noise, self._equation, tau)
        if noise_terms is None:
            self._noise = fit_residual_noise(residual, self._noise)
        else:
            self._noise = fit_residual_noise(ResidualSpectrum(noise_terms, c), self._noise, residual)
        run = whitened_run.whiten_run(
            terms,
            self._noise,
            self._parameter_map,
            likelihood=self._likelihood,
            c=c if iteration > WARM_UP else None,  # before, no residual can tell an outlier
            equation=self._equation,
        )
        return run if noise_terms is None else attenuation.corrected(run, noise_terms, self._noise, c)


def component(run: LisaRun, equation: lisa_dynamics.Equation, tau: tuple[float, float]) -> Spectra:
    """Return the spectra of the columns of a component of D."""
    spectra = run.spectra(tau)
    return replace(spectra, columns=spectra.columns @ equation.basis)
