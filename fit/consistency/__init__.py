"""Consistency: which runs agree with each other, their joint fit, what is wrong with the others."""

from fit.consistency.consistent_fit import ConsistentFit, consistency_warnings, fit_consistent_runs
from fit.consistency.likely_causes import explain_findings

__all__ = [
    "ConsistentFit",
    "consistency_warnings",
    "explain_findings",
    "fit_consistent_runs",
]
