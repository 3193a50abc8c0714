"""Whitening: runs as whitened, weighted least squares.

Runs are paired with their noise runs, become spectra of the model's columns at any delay, and are whitened by
the PSD of the noise run. A `WhitenedRun` holds all of chi^2 of a run in a small triangle.
"""

from fit.whitening.experiment import Experiment, divide, pair
from fit.whitening.likelihoods import Likelihood, Weights, expected_weights, weights
from fit.whitening.residual_psd import ResidualSpectrum, fit_residual_noise, noise_model
from fit.whitening.run import MAX_DELAY_SHIFT, Run, check_coverage
from fit.whitening.system_run import system_run
from fit.whitening.whitened_run import WhitenedRun
