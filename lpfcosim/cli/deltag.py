"""The command ``deltag``: the calibrated Delta g of telemetry, term by term."""

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from fit.deltag import write_delta_g
from fit.results import load, results_beside, results_file, sound_joint
from fit.telemetry import open_run
from lpfcosim.cli.console import Console
from lpfcosim.cli.fit import default_folder
from lpfcosim.errors import InputError
from lpfcosim.execution import checksums, results_folder
from lpfcosim.messages import grouped
from lpfcosim.workflows import calibration as workflow
from lpfcosim.workflows import output_paths


def deltag(paths: Sequence[Path], calibration: Path | None, out: Path | None, console: Console) -> None:
    """Write the calibrated Delta g of telemetry files; by default with the results in their folder."""
    directory = out or default_folder(paths[0], "deltag")
    output_paths.check_folder(directory, "telemetry")
    file = results_file(calibration) if calibration else _results_of(paths)
    results = load(file)
    sound_joint(results, str(file))
    if calibration is None:
        console.note(f"calibration: {file}")
    inputs = workflow.find_telemetry(paths, directory, console, any_gaps=True)
    with console.stage("reading"):
        for path in inputs:
            open_run(path)  # nothing is written where one is missing
    outputs = {f"{path.stem}-deltag.h5": path for path in inputs}
    for path in inputs:
        if outputs[f"{path.stem}-deltag.h5"] is not path:
            raise InputError(f"{path}: a second file of that name, expected different names")
    origin = {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "calibration_sha256": checksums.digest(file),
    }
    notes: list[tuple[str, str]] = []
    try:
        for name, path in outputs.items():
            with results_folder.lock(directory, alternative=True), console.stage(str(path)):
                of_file = write_delta_g(path, directory / name, results, {**origin, "source": path.name})
            notes += [(path.name, note) for note in of_file]
            console.print_line(str(directory / name))
    finally:
        for sentence in grouped(notes, "file"):
            console.warn(sentence)


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
