"""Signals: exact derivatives and delays of sampled channels, windows, transforms, noise PSDs, averages.

Nothing here knows what the channels mean.
"""

from fit.signal.binned import Estimator
from fit.signal.logpsd import LogSpectrum, log_psd
from fit.signal.spectra import NoiseModel, Spectra, Spectrum

__all__ = ["Estimator", "LogSpectrum", "NoiseModel", "Spectra", "Spectrum", "log_psd", "spectra"]
