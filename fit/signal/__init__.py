"""Signals: exact derivatives and delays of sampled channels, windows, transforms, noise PSDs, averages.

Nothing here knows what the channels mean.
"""

from fit.signal.averages import Binned, Estimator, LogSpectrum, log_psd
from fit.signal.noise import NoiseModel, fit_noise
from fit.signal.spectra import Spectra, Spectrum
from fit.signal.threads import one_thread

__all__ = [
    "Binned",
    "Estimator",
    "LogSpectrum",
    "NoiseModel",
    "Spectra",
    "Spectrum",
    "derivatives",
    "fit_noise",
    "log_psd",
    "one_thread",
    "spectra",
]
