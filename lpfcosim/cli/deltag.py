"""The command ``deltag``: the calibrated Delta g of telemetry, term by term."""

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from fit.deltag import write_delta_g
from fit.results import load, sound_joint
from fit.telemetry import reader
from lpfcosim.cli.common import check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.fit import default_folder, telemetry
from lpfcosim.errors import InputError
from lpfcosim.running import folder, ledger


def deltag(paths: Sequence[Path], calibration: Path, out: Path | None, console: Console) -> None:
    """Write the calibrated Delta g of telemetry files."""
    directory = out or default_folder(paths[0], "deltag")
    check_folder(directory, "telemetry")
    results = load(calibration)
    sound_joint(results, str(calibration))
    inputs = reader.files(telemetry(console, paths, directory, any_gaps=True))
    with console.stage("reading"):
        reader.check(inputs)
        for path in inputs:
            reader.samples(path)  # nothing is written where one is missing
    outputs = {f"{path.stem}-deltag.h5": path for path in inputs}
    for path in inputs:
        if outputs[f"{path.stem}-deltag.h5"] is not path:
            raise InputError(f"{path}: a second file of that name, expected different names")
    origin = {
        "lpfcosim_version": metadata.version("lpfcosim"),
        "calibration_sha256": ledger.digest(calibration),
    }
    for name, path in outputs.items():
        with folder.held(directory, "--out"), console.stage(str(path)):
            notes = write_delta_g(path, directory / name, results, {**origin, "source": path.name})
        for note in notes:
            console.note(f"warning: {note}")
        console.say(str(directory / name))
