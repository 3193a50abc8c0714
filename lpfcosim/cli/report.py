"""The command ``report``: the report anew from what a folder holds."""

from pathlib import Path

from fit.crosstalk import refit
from fit.report import page as fit_report
from lpfcosim.cli.console import Console
from lpfcosim.execution import results_folder


def report(directory: Path, console: Console) -> None:
    """Rebuild the report from what a folder holds."""
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    with results_folder.lock(directory), console.stage("report"):
        page = fit_report.write_report(directory, results, telemetries)
    console.print_line(f"report: {page}")
