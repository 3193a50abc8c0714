"""The motion of a LISA constellation, from the telemetry of three simulated runs."""

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from fit.results import telemetry_files
from fit.telemetry import root_attributes
from lpfcosim.constellation import join
from lpfcosim.constellation import write_jitter as write_file
from lpfcosim.errors import InputError
from lpfcosim.workflows.progress import Progress


def write_jitter(paths: Sequence[Path], out: Path, progress: Progress, *, noise: bool = False) -> Path:
    """Write the motion of three spacecraft as a file of schema ``lisa-jitter/1``.

    Parameters
    ----------
    paths : sequence of Path
        Telemetry of spacecraft 1, 2 and 3, or folders of it; of a folder the runs with injections are taken,
        in the order of their names.
    out : Path
        The file.
    progress : Progress
        Its callbacks.
    noise : bool
        Of folders take the noise runs.

    Raises
    ------
    InputError
        If these are not three runs that belong together.
    """
    files = [file for path in paths for file in _runs(path, "noise" if noise else "sysid")]
    with progress.stage("reading"):
        jitter = join(files)
    write_file(jitter, out, {"lpfcosim_version": metadata.version("lpfcosim")})
    return out


def _runs(path: Path, kind: str) -> list[Path]:
    """Return the file, or those of a folder that are of a kind."""
    files = telemetry_files([path])
    if not path.is_dir():
        return files
    runs = sorted(file for file in files if (root_attributes(file) or {}).get("kind") == kind)
    if not runs:
        raise InputError(f"{path}: no run of kind {kind!r} in it, expected runs of three spacecraft")
    return runs
