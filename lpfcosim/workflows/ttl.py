"""Tilt-to-length coupling calibrated into a folder: ``results.json`` and ``report.html``."""

import os
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

from fit import api
from fit.errors import FitError
from fit.report import page
from fit.results import Fit, Results, estimates, write
from fit.tables import Table
from lpfcosim.execution import checksums, results_folder
from lpfcosim.workflows.progress import Progress

VERSIONS = ("lpfcosim", "numpy", "scipy", "lmfit")  # on which results depend


@dataclass(frozen=True, repr=False)
class TtlCalibration:
    """The coefficients of tilt-to-length coupling and the file that holds them.

    Attributes
    ----------
    results : Results
        With the section ``ttl``.
    path : Path
        Their file, of schema ``lpf-results/1``.
    report : Path
        ``report.html`` in the same folder.
    """

    results: Results
    path: Path
    report: Path

    @property
    def fit(self) -> Fit:
        """The section ``ttl``."""
        assert self.results.ttl is not None
        return self.results.ttl

    def table(self) -> Table:
        """Return the estimates."""
        return estimates({"": self.fit})

    def check_sound(self) -> None:
        """Raise FitError if the sigmas are not valid."""
        for place, warning in self.results.unsound:
            raise FitError(f"{self.path}: {place}: {warning.message}")


def calibrate_into(
    directory: Path,
    measurements: Path,
    noise: Path | None,
    progress: Progress,
) -> TtlCalibration:
    """Calibrate tilt-to-length coupling, and write the results to a folder.

    Parameters
    ----------
    directory : Path
        The folder.
    measurements, noise : Path
        Files of measurements, see `fit.calibrate_ttl`.
    progress : Progress
        Its callbacks.
    """
    with progress.stage("fit"):
        results = api.calibrate_ttl(measurements, noise)
    files = [measurements] if noise is None else [measurements, noise]
    details = replace(
        results.provenance,
        extra=results.provenance.extra | {"sha256": {path.name: checksums.digest(path) for path in files}},
        versions={name: metadata.version(name) for name in VERSIONS},
        telemetry=[os.path.relpath(path, directory) for path in files],
    )
    results = replace(results, provenance=details)
    path = directory / "results.json"
    with results_folder.lock(directory, alternative=True):
        write(results, path)
        report = page.write_report(directory, results, [])
    return TtlCalibration(results, path, report)
