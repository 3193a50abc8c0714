"""Warnings of a calibration: for each code its severity, what the verdict says and what to do about it.

Code that raises a warning, or judges a fit by one, looks up its code in `WARNING_KINDS`. Messages are for the
user alone and never parsed: what is wrong is in the causes of a warning, which are records.
"""

from fit.warnings.causes import Cause, either
from fit.warnings.fit_warning import (
    UNDETERMINED,
    FitWarning,
    TimeSpan,
    distinct_messages,
    masked_spans,
    undetermined,
)
from fit.warnings.kinds import WARNING_KINDS, Severity

__all__ = [
    "UNDETERMINED",
    "WARNING_KINDS",
    "Cause",
    "FitWarning",
    "Severity",
    "TimeSpan",
    "distinct_messages",
    "either",
    "masked_spans",
    "undetermined",
]
