"""What weighs one run of an iteration, ever better: by a smooth PSD, or as LTPDA does."""

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fit.fitting import ltpda_flscov, readout_excess_noise, regressor_noise
from fit.model import Equation
from fit.spectra import NoiseModel
from fit.whitening import Experiment, Likelihood, noise_model, system_run, whitened_run

Array = NDArray[np.float64]

WARM_UP = 1  # iteration up to which the signal may still be in the residual
LATE = 6  # iteration from which noise that creeps is hastened; most fits are over before
CREEPING, ALIGNED = 0.7, 0.95  # beside the last change of log S: length and cosine of one that creeps
FARTHEST = 1.0  # in log S, at once


class Weighing(Protocol):
    """What weighs one run, ever better."""

    @property
    def name(self) -> str:
        """Of the experiment."""

    @property
    def converged(self) -> bool:
        """Whether the weights themselves have come to rest."""

    def block(self, theta: Array, covariance: Array, iteration: int) -> whitened_run.WhitenedRun:
        """Return the run weighed at the estimate theta, shape (P,), of that covariance, shape (P, P)."""


class SmoothWeighing:
    """Weighs the sysid run of an experiment in each of its equations.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    share : ndarray, shape (K, P)
        The `parameter_map` of a `whitened_run.WhitenedRun`.
    likelihood : str
        Of the residual, see `fit.whitening.likelihoods`, unless its level is marginalised.
    initial : whitened_run.WhitenedRun or None
        The run as another fit has weighed it, which is where the iteration begins.
    """

    converged = True

    def __init__(
        self,
        experiment: Experiment,
        share: Array,
        likelihood: Likelihood,
        initial: whitened_run.WhitenedRun | None,
    ) -> None:
        self.name = experiment.name
        self._share, self._initial = share, initial
        likelihood = "marginalised" if experiment.marginalised else likelihood
        models = (
            [block.noise for block in initial.blocks] if initial else [None] * len(experiment.sysid.equations)
        )
        self._equations = [_SmoothPSD(experiment, i, share, likelihood, S) for i, S in enumerate(models)]

    def block(self, theta: Array, covariance: Array, iteration: int) -> whitened_run.WhitenedRun:
        """As that of `Weighing`."""
        if self._initial and iteration == 0:
            return replace(self._initial, parameter_map=self._share)
        of_run = self._share @ covariance @ self._share.T
        return system_run([e.block(self._share @ theta, of_run, iteration) for e in self._equations])


class _SmoothPSD:
    """Weighs an equation of a run by the smooth PSD of its noise run, and by what its residual is like."""

    def __init__(
        self,
        experiment: Experiment,
        index: int,
        share: Array,
        likelihood: Likelihood,
        model: NoiseModel | None,
    ) -> None:
        self._experiment, self._index, self._share, self._likelihood = experiment, index, share, likelihood
        self._equation = experiment.sysid.equations[index]
        self._model = model
        self._change: Array | None = None

    def block(self, theta: Array, covariance: Array, iteration: int) -> whitened_run.WhitenedRun:
        """Return the equation weighed at parameters of the run, shape (K,), of that covariance, (K, K)."""
        equation, run = self._equation, self._experiment.sysid
        model = noise_model(self._experiment, theta, covariance, self._model, self._index)
        self._model = self._accelerated(model) if iteration >= LATE else model
        terms = run.spectra(run.spacecraft.delays_of(theta, equation.parameters), self._model)
        if self._experiment.readout_excess:
            terms = readout_excess_noise.use_injections_only(terms)
        terms = equation.spectra(terms)
        # before the signal is subtracted, no residual shows an outlier
        c = equation.coefficients(theta, terms.tau) if iteration > WARM_UP else None
        block = whitened_run.whiten_run(
            terms, self._model, self._share, likelihood=self._likelihood, c=c, equation=equation
        )
        if not (equation.noisy and self._experiment.noise):
            return block
        noise_terms = equation.spectra(self._experiment.noise.spectra(terms.tau))
        return regressor_noise.corrected(block, noise_terms, self._model, c)

    def _accelerated(self, model: NoiseModel) -> NoiseModel:
        """Return a model of the noise, or where it goes if it creeps.

        What constant and ramp leave of the lowest bins depends on their weights, and these on what is left.
        """
        previous, last_change = self._model, self._change
        if previous is None or not np.array_equal(previous.knots, model.knots):
            self._change = None
            return model
        self._change = change = model.values - previous.values
        if last_change is None or last_change.size != change.size:
            return model
        along, size = float(change @ last_change), float(last_change @ last_change)
        if not (CREEPING * size < along < size and along > ALIGNED * np.sqrt(size * float(change @ change))):
            return model
        self._change = None  # what follows a leap gives no estimate of the pace
        leap = min(along / (size - along), FARTHEST / float(np.abs(change).max()))  # a geometric series
        return replace(model, values=model.values + leap * change)


class LTPDAWeighing:
    """Weighs a run as LTPDA does, see `fit.fitting.ltpda_flscov`."""

    def __init__(self, experiment: Experiment, share: Array) -> None:
        self._experiment, self._share = experiment, share
        self.name = experiment.name
        self._total = 0.0
        self.converged = False

    def block(self, theta: Array, _: Array, iteration: int) -> whitened_run.WhitenedRun:
        """As that of `Weighing`."""
        run, equations = self._experiment.sysid, self._experiment.sysid.equations
        of_run = self._share @ theta
        terms = run.columns(run.spacecraft.delays_of(of_run, self._experiment.parameters))

        def weighed(equation: Equation) -> tuple[whitened_run.WhitenedRun, float]:
            c = equation.coefficients(of_run, terms.tau) if iteration else None
            return ltpda_flscov.block(terms, equation, self._share, c)

        blocks, totals = zip(*map(weighed, equations), strict=True)
        total = sum(totals)
        self.converged = abs(total - self._total) < ltpda_flscov.TOLERANCE * total
        self._total = total
        return system_run(blocks)
