"""Signals: exact derivatives and delays of sampled channels, windows, transforms, noise PSDs, averages.

Nothing here knows what the channels mean.
"""

from fit.signal import patches, windows
from fit.signal.averages import Binned, Estimator, Level, LogSpectrum, log_psd, log_psds, welch
from fit.signal.excess import Excess
from fit.signal.medians import median
from fit.signal.noise import NoiseModel, fit_noise
from fit.signal.spectra import Spectra, Spectrum

__all__ = [
    "Binned",
    "Estimator",
    "Excess",
    "Level",
    "LogSpectrum",
    "NoiseModel",
    "Spectra",
    "Spectrum",
    "derivatives",
    "fit_noise",
    "log_psd",
    "log_psds",
    "median",
    "patches",
    "spectra",
    "welch",
    "windows",
]
