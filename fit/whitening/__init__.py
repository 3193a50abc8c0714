"""Weighing: runs as whitened, weighted least squares.

Runs are paired with their noise runs, become spectra of the model's columns at any delay, and are whitened by
the noise PSD that the partner tells. A block holds all of chi^2 of a run in a small triangle.
"""

from fit.whitening.glitch_templates import Glitch, Shape
from fit.whitening.likelihoods import NU, Likelihood, Weights, expected_weights, weights
from fit.whitening.run import Run, check_left
from fit.whitening.runs import Experiment, Left, divide, noise_model, pair, smooth_noise
from fit.whitening.whitened_run import WhitenedRun

__all__ = [
    "NU",
    "Experiment",
    "Glitch",
    "Left",
    "Likelihood",
    "Run",
    "Shape",
    "Weights",
    "WhitenedRun",
    "check_left",
    "divide",
    "expected_weights",
    "glitch_templates",
    "noise_model",
    "pair",
    "smooth_noise",
    "weights",
    "whitened_run",
]
