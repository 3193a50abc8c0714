"""Spectra: exact derivatives and delays of sampled channels, windows, transforms, noise PSDs, averages.

The physical meaning of the channels plays no part here.
"""

from fit.spectra.averaged_spectra import Binned, Estimator, LogSpectrum, asd, log_psds
from fit.spectra.excess import Excess
from fit.spectra.noise_psd import NoiseModel, fit_noise
from fit.spectra.windowing import Spectra, Spectrum
