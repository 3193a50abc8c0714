"""The report: one page from telemetry and results, and its figures for a notebook."""

__all__ = ["page", "plot"]
