"""The calibrated Delta g of telemetry, term by term, in files."""

from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

from fit.deltag import write_delta_g
from fit.results import load, results_beside, results_file, sound_joint
from fit.telemetry import open_run
from lpfcosim.errors import InputError
from lpfcosim.execution import checksums, results_folder
from lpfcosim.messages import grouped
from lpfcosim.workflows.calibration import find_telemetry
from lpfcosim.workflows.progress import Progress


def write_deltag(
    paths: Sequence[Path], calibration: Path | None, directory: Path, progress: Progress
) -> Iterator[Path]:
    """Write the calibrated Delta g of telemetry, and yield each file that is written.

    Parameters
    ----------
    paths : sequence of Path
        Telemetry, folders of it or maps.
    calibration : Path, optional
        The results, by default those in the folder of the telemetry.
    directory : Path
        The folder for the files.
    progress : Progress
        Its callbacks.

    Raises
    ------
    InputError, FitError
        If telemetry or results cannot be read; if the joint fit is not sound.
    """
    file = results_file(calibration) if calibration else _results_of(paths)
    results = load(file)
    sound_joint(results, str(file))
    if calibration is None:
        progress.note(f"calibration: {file}")
    inputs = find_telemetry(paths, directory, progress, any_gaps=True)
    with progress.stage("reading"):
        for path in inputs:
            open_run(path)  # nothing is written where one is missing
    outputs = {directory / f"{path.stem}-deltag.h5": path for path in inputs}
    if len(outputs) < len(inputs):
        raise InputError(f"{directory}: two files of telemetry of one name, expected different names")
    origin = {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "calibration_sha256": checksums.digest(file),
    }
    notes: list[tuple[str, str]] = []
    try:
        for output, path in outputs.items():
            with results_folder.lock(directory, alternative=True), progress.stage(str(path)):
                of_file = write_delta_g(path, output, results, {**origin, "source": path.name})
            notes += [(path.name, note) for note in of_file]
            yield output
    finally:
        for sentence in grouped(notes, "file"):
            progress.warn(sentence)


def _results_of(paths: Sequence[Path]) -> Path:
    """Return the results in the folders of telemetry, which must be the same for all."""
    advice = "name the calibration with --calibration"
    files = []
    for path in paths:
        file = results_beside(path)
        if file is None:
            raise InputError(
                f"{path}: no results.json in its folder, expected telemetry in the folder of an earlier fit; "
                + advice
            )
        files.append(file)
    for file in files[1:]:
        if checksums.digest(file) != checksums.digest(files[0]):
            raise InputError(f"{file}: other results than {files[0]}, expected one calibration; {advice}")
    return files[0]
