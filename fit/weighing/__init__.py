"""Weighing: runs as whitened, weighted least squares.

Runs are paired with their noise runs, become spectra of the model's columns at any delay, and are whitened by
the noise PSD that the partner tells. A block holds all of chi^2 of a run in a small triangle.
"""

from fit.weighing.likelihood import NU, Likelihood, Weights, expected_weights, weights
from fit.weighing.linear import Block
from fit.weighing.run import Run, check_left
from fit.weighing.runs import (
    Experiment,
    Left,
    divide,
    noise_model,
    pair,
    smooth_noise,
)
from fit.weighing.shapes import Glitch, Shape
from fit.weighing.tones import drives, single_tone

__all__ = [
    "NU",
    "Block",
    "Experiment",
    "Glitch",
    "Left",
    "Likelihood",
    "Run",
    "Shape",
    "Weights",
    "check_left",
    "divide",
    "drives",
    "expected_weights",
    "linear",
    "noise_model",
    "pair",
    "shapes",
    "single_tone",
    "smooth_noise",
    "weights",
]
