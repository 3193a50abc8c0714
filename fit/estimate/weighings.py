"""What weighs one run of an iteration, ever better: by a smooth PSD, or as LTPDA does."""

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fit.estimate import flscov, louder, unsteady
from fit.model import dynamics
from fit.settings import Estimator
from fit.weighing import Experiment, Likelihood, linear, noise_model

Array = NDArray[np.float64]

WARM_UP = 1  # iteration up to which the signal may still be in the residual


class Weighing(Protocol):
    """What weighs one run, ever better."""

    @property
    def settled(self) -> bool:
        """Whether the weights themselves have come to rest."""

    def block(self, theta: Array, covariance: Array, iteration: int) -> linear.Block:
        """Return the run weighed at the estimate theta, shape (P,), of that covariance, shape (P, P)."""


def weighing(
    experiment: Experiment, share: Array, estimator: Estimator, begun: linear.Block | None
) -> Weighing:
    """Return what weighs the sysid run of an experiment.

    Parameters
    ----------
    experiment : Experiment
        The runs.
    share : ndarray, shape (K, P)
        See `linear.Block`.
    estimator : str
        ``flscov``, or the likelihood of the residual, see `fit.weighing.likelihood`.
    begun : linear.Block or None
        The run as another fit has weighed it, which is where the iteration begins.
    """
    if estimator == "flscov":
        return _Flscov(experiment, share)
    return _Smooth(experiment, share, "marginalised" if experiment.levels else estimator, begun)


class _Smooth:
    """Weighs a run by the smooth PSD of its noise run, and by what its own residual then is like."""

    def __init__(
        self, experiment: Experiment, share: Array, likelihood: Likelihood, begun: linear.Block | None
    ) -> None:
        self._experiment, self._share, self._likelihood = experiment, share, likelihood
        self._own = len(experiment.parameters)  # what the gains do within the run comes after
        self._begun = begun if self._own == len(share) else None
        self._model = begun.noise if begun else None
        self.settled = True

    def block(self, theta: Array, covariance: Array, iteration: int) -> linear.Block:
        if self._begun and iteration == 0:
            return replace(self._begun, share=self._share)
        share, of_run, run, own = self._share, self._share @ theta, self._experiment.sysid, self._own
        spread = (share @ covariance @ share.T)[:own, :own]
        self._model = noise_model(self._experiment, of_run[:own], spread, self._model)
        tau = dynamics.delays(of_run)
        terms = run.spectra(tau)
        if self._experiment.louder:
            terms = louder.at_injections(terms)
        if own < len(share):
            terms = terms.beside(run.wander(tau))
        # before the signal is subtracted, no residual can tell an outlier
        c = dynamics.coefficients(of_run, terms.tau) if iteration > WARM_UP else None
        block = linear.block(terms, self._model, share, likelihood=self._likelihood, c=c)
        steps = self._experiment.unsteady
        return unsteady.block(block, terms.f, steps) if steps else block


class _Flscov:
    """Weighs a run as LTPDA does."""

    def __init__(self, experiment: Experiment, share: Array) -> None:
        self._experiment, self._share = experiment, share
        self._total = 0.0
        self.settled = False

    def block(self, theta: Array, _: Array, iteration: int) -> linear.Block:
        of_run = self._share @ theta
        terms = self._experiment.sysid.columns(dynamics.delays(of_run))
        c = dynamics.coefficients(of_run, terms.tau) if iteration else None
        block, total = flscov.block(terms, self._share, c)
        self.settled = abs(total - self._total) < flscov.TOLERANCE * total
        self._total = total
        return block
