"""Calibrate a drag-free spacecraft from simulated or flight telemetry.

::

    runs = fit.load("quickstart/telemetry")
    results = fit.calibrate(runs)
    results.joint["lambda_2"].value
    delta_g = fit.delta_g(runs[0], results).to_xarray()
    f, asd, sigma = fit.asd(delta_g["delta_g"], fs=2.0)
    fit.plot.spectra(results, runs, "D")
    fit.save_report(results, runs, "folder")

Names are imported on first use, so that ``import fit`` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fit.api import (
        calibrate,
        calibrate_inertial,
        calibrate_ttl,
        load,
        load_results,
        make_params,
        save_report,
    )
    from fit.checks.leave_one_out import leave_one_out
    from fit.comparison import Comparison, compare
    from fit.deltag import delta_g
    from fit.errors import CalibrationError, FitError, InputError
    from fit.findings import Finding
    from fit.fitting import Prior, delta_chi2
    from fit.report import plot
    from fit.results import Estimate, Fit, Results
    from fit.sampling import Chain, sample
    from fit.spectra import asd
    from fit.telemetry import Telemetry

__all__ = [
    "CalibrationError",
    "Chain",
    "Comparison",
    "Estimate",
    "Finding",
    "Fit",
    "FitError",
    "InputError",
    "Prior",
    "Results",
    "Telemetry",
    "asd",
    "calibrate",
    "calibrate_inertial",
    "calibrate_ttl",
    "compare",
    "delta_chi2",
    "delta_g",
    "leave_one_out",
    "load",
    "load_results",
    "make_params",
    "plot",
    "sample",
    "save_report",
]
_HOME = {
    "api": (
        "calibrate",
        "calibrate_inertial",
        "calibrate_ttl",
        "load",
        "load_results",
        "make_params",
        "save_report",
    ),
    "comparison": ("Comparison", "compare"),
    "checks.leave_one_out": ("leave_one_out",),
    "deltag": ("delta_g",),
    "errors": ("CalibrationError", "FitError", "InputError"),
    "fitting": ("Prior", "delta_chi2"),
    "results": ("Estimate", "Fit", "Results"),
    "sampling": ("Chain", "sample"),
    "spectra": ("asd",),
    "findings": ("Finding",),
    "telemetry.reader": ("Telemetry",),
}


def __getattr__(name: str) -> object:
    if name == "plot":
        return import_module("fit.report.plot")
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"fit.{module}"), name)
    raise AttributeError(f"module 'fit' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
