"""The report: one page from telemetry and results, and its figures for a notebook."""

from fit.report import page, plot

__all__ = ["page", "plot"]
