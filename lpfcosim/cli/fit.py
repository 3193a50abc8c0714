"""The command ``fit``: from telemetry to results and report; ``run`` ends with it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path

from fit import api
from fit import settings as fit_settings
from fit.errors import FitError
from fit.files import is_file
from fit.report import page
from fit.results import Results, load, results_file, sound_joint, telemetry_files, write
from fit.telemetry import Telemetry, archive_conversion, read_all
from lpfcosim.cli.common import check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.constraints import Constraints
from lpfcosim.execution import checksums
from lpfcosim.execution import results_folder as folders

VERSIONS = ("lpfcosim", "numpy", "scipy", "lmfit", "fmpy")  # on which results depend


def fit_files(
    paths: Sequence[Path],
    out: Path | None,
    console: Console,
    *,
    settings: Path | None,
    include_short: bool,
    calibration: Path | None,
    constraints: Constraints,
) -> None:
    """Fit telemetry files from anywhere, report."""
    directory = out or default_folder(paths[0])
    check_folder(directory, "telemetry")
    calibration = results_file(calibration) if calibration else None
    chosen = fit_settings.read(settings) if settings else fit_settings.settings()
    if include_short:
        chosen = chosen.model_copy(update={"include_short": True})
    chosen = constraints.on(chosen)
    fit_settings.refuse_fmu_parameters(chosen, "fit.parameters")
    found = telemetry(console, paths, directory, any_gaps=False)
    calibrated(console, directory, found, chosen, calibration=calibration)


def calibrated(
    console: Console,
    directory: Path,
    paths: Sequence[Path],
    chosen: fit_settings.Settings,
    *,
    own: bool = False,
    calibration: Path | None = None,
    origin: Mapping[str, str | int | float] | None = None,
    admitted: Callable[[Sequence[Telemetry]], None] = lambda _: None,
    told: Callable[[Results], Results] = lambda results: results,
    printed: bool = True,
) -> None:
    """Fit telemetry, keep the results and the report in a folder, and have them `printed`.

    Files that are our `own` need not be tried by another process first. With a `calibration` the dynamics
    are taken from there, and only the inertial forces are fitted. `origin` is how the telemetry came to be;
    `admitted` refuses telemetry before it is fitted, `told` adds to the results what else there is to tell.

    Raises
    ------
    FitError
        At the end, if sigmas do not hold.
    """
    if calibration is not None:
        known = load(calibration)
        sound_joint(known, str(calibration))
        origin = {"calibration": str(calibration), "calibration_sha256": checksums.digest(calibration)}
    with console.stage("reading"):
        telemetries = read_all(paths, trusted=own)
    admitted(telemetries)
    with console.stage("fit"):
        if calibration is not None:
            results = api.calibrate_inertial(telemetries, known, parameters=chosen.parameters)
        else:
            results = api.calibrate(telemetries, **chosen.record())
    results = replace(
        results,
        provenance=replace(
            results.provenance,
            extra={**results.provenance.extra, **(origin or {})},
            versions={name: metadata.version(name) for name in VERSIONS},
            telemetry=[os.path.relpath(t.path, directory) for t in telemetries],
        ),
    )
    results = told(results)
    with folders.lock(directory, "--out"):
        document = write(results, directory / "results.json")
        with console.stage("report"):
            report = page.write_report(directory, results, telemetries)
    if printed:
        console.table(results)
        console.document(document)
        console.say(f"report: {report}")
    for place, warning in results.unsound:
        raise FitError(f"{directory / 'results.json'}: {place}: {warning.message}")


def telemetry(console: Console, paths: Sequence[Path], directory: Path, *, any_gaps: bool) -> list[Path]:
    """Return the telemetry files that paths mean; what maps describe is converted into `directory` first."""
    if any(map(archive_conversion.is_map, paths)):
        with console.stage("conversion"):
            paths = archive_conversion.convert(paths, directory / "telemetry", any_gaps=any_gaps)
    return telemetry_files(paths)


def default_folder(path: Path, suffix: str = "fit") -> Path:
    """Return the folder for results that is named after their input."""
    name = path.resolve().stem if is_file(path) else path.resolve().name
    folder = Path(name)
    # Never beside or over the input.
    return Path(f"{name}-{suffix}") if folder.exists() and folder.resolve() == path.resolve() else folder
