"""The command ``fit``: from telemetry to results and report."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from fit import settings as fit_settings
from fit.files import is_file
from fit.results import results_file
from lpfcosim.cli.console import Console
from lpfcosim.cli.constraints import Constraints
from lpfcosim.workflows import calibration as workflow
from lpfcosim.workflows import output_paths


def fit_files(
    paths: Sequence[Path],
    out: Path | None,
    console: Console,
    *,
    settings: Path | None,
    include_short: bool,
    calibration: Path | None,
    constraints: Constraints,
    band: Mapping[str, float],
) -> None:
    """Fit telemetry files from anywhere, report."""
    directory = out or default_folder(paths[0])
    output_paths.check_folder(directory, "telemetry")
    dynamics, provenance = workflow.read_dynamics(results_file(calibration)) if calibration else (None, None)
    chosen = fit_settings.read(settings) if settings else fit_settings.settings()
    if include_short:
        chosen = chosen.model_copy(update={"include_short": True})
    # a campaign constrains parameters of FMUs for lpfcosim identify
    chosen = workflow.constrain(chosen.without_fmu_parameters(), constraints.tables(), band)
    fit_settings.refuse_fmu_parameters(chosen, "options.parameters")
    runs = workflow.read_telemetry(paths, directory, console)
    console.show_calibration(
        workflow.calibrate_into(directory, runs, chosen, console, dynamics=dynamics, provenance=provenance)
    )


def default_folder(path: Path, suffix: str = "fit") -> Path:
    """Return the folder for results that is named after their input."""
    name = path.resolve().stem if is_file(path) else path.resolve().name
    folder = Path(name)
    # Never beside or over the input.
    return Path(f"{name}-{suffix}") if folder.exists() and folder.resolve() == path.resolve() else folder
