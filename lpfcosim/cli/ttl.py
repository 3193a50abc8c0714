"""The command ``ttl``: tilt-to-length coefficients from TDI and wavefront sensing."""

from pathlib import Path

from lpfcosim.cli.console import Console
from lpfcosim.cli.fit import default_folder
from lpfcosim.workflows import output_paths
from lpfcosim.workflows import ttl as workflow


def ttl(measurements: Path, noise: Path | None, out: Path | None, console: Console) -> None:
    """Calibrate the coupling, print the coefficients."""
    directory = out or default_folder(measurements, "ttl")
    output_paths.check_folder(directory)
    calibration = workflow.calibrate_into(directory, measurements, noise, console)
    console.print_table(calibration.table())
    for message in dict.fromkeys(w.message for w in calibration.fit.warnings):
        console.warn(message)
    console.print_json(calibration.path.read_text(encoding="utf-8"))
    console.print_line(f"report: {calibration.report}")
    calibration.check_sound()
