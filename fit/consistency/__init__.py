"""Consistency: which runs agree with each other, their joint fit, what is wrong with the others."""

from fit.consistency.consistent_fit import consistency_warnings, fit_consistent_runs
from fit.consistency.equation_test import equation_warnings
from fit.consistency.likely_causes import explain_findings
from fit.consistency.model_misfit import model_warnings

__all__ = [
    "consistency_warnings",
    "equation_warnings",
    "explain_findings",
    "fit_consistent_runs",
    "model_warnings",
]
