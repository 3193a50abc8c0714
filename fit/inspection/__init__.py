"""Inspection: what is masked, taken out or left out before anything is estimated, and why.

Files are held against what they say of themselves and against each other, samples and minutes of a run
against the whole of it; saturation is masked, glitches are masked or taken out.
"""

from fit.inspection.leftout import LeftOut, Tells, told
from fit.inspection.masks import Prepared, prepare_each, searches
from fit.inspection.ready import Ready

__all__ = [
    "LeftOut",
    "Prepared",
    "Ready",
    "Tells",
    "admission",
    "long_noise",
    "prepare_each",
    "samples",
    "searches",
    "told",
]
