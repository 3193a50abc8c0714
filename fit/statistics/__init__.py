"""Statistics of runs and fits that several checks share, each once."""

from fit.statistics import injections, variance
from fit.statistics.initial_fit import initial_fit, initial_noise_psd, lstsq_coefficients

__all__ = ["initial_fit", "initial_noise_psd", "injections", "lstsq_coefficients", "variance"]
