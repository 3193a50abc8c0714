"""The command ``jitter``: the motion of three simulated spacecraft as one file."""

from collections.abc import Sequence
from pathlib import Path

from lpfcosim.cli.console import Console
from lpfcosim.workflows import jitter as workflow
from lpfcosim.workflows import output_paths


def jitter(paths: Sequence[Path], out: Path, console: Console, *, noise: bool) -> None:
    """Write the file."""
    output_paths.check_file(out, paths, (".h5", ".hdf5"))
    console.print_line(str(workflow.write_jitter(paths, out, console, noise=noise)))
