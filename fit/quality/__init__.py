"""Quality of the data: what is masked, subtracted or excluded before anything is estimated, and why.

`metadata` holds the table of checks of files and samples. Saturation, spikes and
glitches are masked, and noise is compared with the noise run.
"""

from fit.quality.campaign import Campaign, participation
from fit.quality.channel_units import unit_faults
from fit.quality.fit_quality import as_fit, indeterminable, report
from fit.quality.initial_fit import has_spectra
from fit.quality.masks import MODEL_MISFIT, mask_experiments, mask_spikes

__all__ = [
    "MODEL_MISFIT",
    "Campaign",
    "as_fit",
    "drifts",
    "fit_quality",
    "has_spectra",
    "indeterminable",
    "initial_fit",
    "long_glitches",
    "mask_experiments",
    "mask_spikes",
    "metadata",
    "noise_adaptation",
    "noise_tests",
    "participation",
    "report",
    "unit_faults",
]
