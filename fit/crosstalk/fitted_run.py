"""The runs of a finished fit, with their spectra and the noise that whitened them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fit.fitting import IRLSResult
from fit.model import dynamics
from fit.spectra import NoiseModel, Spectra
from fit.whitening import Experiment, noise_model, whitened_run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FittedRun:
    """A run as of the last iteration of a fit.

    Attributes
    ----------
    experiment : Experiment
        Whose sysid run it is.
    terms : Spectra
        Of that run.
    noise : NoiseModel
        PSD of its noise.
    block : whitened_run.WhitenedRun
        As it was weighed last.
    """

    experiment: Experiment
    terms: Spectra
    noise: NoiseModel
    block: whitened_run.WhitenedRun

    @property
    def S(self) -> Array:
        """Power to expect of its noise, shape (B,)."""
        return self.noise.expected(self.terms.f)


def fitted_runs(outcome: IRLSResult, experiments: Sequence[Experiment]) -> list[FittedRun]:
    """Return the sysid runs as of the last iteration."""
    theta, covariance = outcome.solution.theta, outcome.solution.covariance
    runs = []
    for experiment, block in zip(experiments, outcome.whitened_runs, strict=True):
        of_run, share = block.parameter_map @ theta, block.parameter_map
        noise = noise_model(experiment, of_run, share @ covariance @ share.T, None)
        terms = experiment.sysid.spectra(dynamics.delays(of_run))
        runs.append(FittedRun(experiment, terms, noise, block))
    return runs
