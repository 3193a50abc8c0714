"""Files from elsewhere are opened by another process first, which may crash, hang or run out of memory.

The library of HDF5 trusts what a file says of itself: a few wrong bytes can make it write where it must not,
or never come to an end. That process reads what the library has to interpret, under limits of time and
memory (`fit.telemetry.look`); what it gets through, this one can read as well.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from fit.errors import InputError
from fit.files import is_file

Kind = Literal["telemetry", "table", "chain"]

MEMORY = 2**32  # bytes
PATIENCE = 60.0  # s
_PACE = 2e7  # bytes per s that are read at least


def check(
    paths: Sequence[Path], kind: Kind = "telemetry", tables: Mapping[Path, str | int | None] | None = None
) -> None:
    """Refuse files that cannot be read, or not within the limits.

    Parameters
    ----------
    paths : sequence of Path
        All of one kind. What is no file is left to whoever opens it.
    kind : {"telemetry", "table", "chain"}
        What they are meant to be: telemetry, archives, chains.
    tables : mapping of Path to str, int or None, optional
        Which table of an archive is meant.

    Raises
    ------
    InputError
        For the first that is at fault.
    """
    for refused in look_at([path for path in paths if is_file(path)], kind, tables or {}):
        if refused is not None:
            raise InputError(refused)


def look_at(files: Sequence[Path], kind: Kind, tables: Mapping[Path, str | int | None]) -> list[str | None]:
    """Return why files are refused, None for sound ones, as far as the first that ends the process."""
    if not files:
        return []
    allowance = PATIENCE + sum(path.stat().st_size for path in files) / _PACE
    names = [[str(path), tables.get(path)] for path in files]
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "fit.telemetry.look"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=_environment(),
    ) as process:
        task = json.dumps({"kind": kind, "memory": MEMORY, "files": names})
        try:
            said, _ = process.communicate(task.encode(), timeout=allowance)
            how = _end(process.returncode)
        except subprocess.TimeoutExpired:
            process.kill()
            said, _ = process.communicate()
            how = f"is not done with in {allowance:.0f} s"
        except BaseException:
            process.kill()
            raise
    found = [json.loads(line)["refused"] for line in said.decode().splitlines() if line.endswith("}")]
    if len(found) < len(files):
        found.append(f"{files[len(found)]}: damaged: {how}, expected a file that can be read")
    return found


def _environment() -> Mapping[str, str]:
    here = str(Path(__file__).parents[2])
    before = os.environ.get("PYTHONPATH")
    path = f"{here}{os.pathsep}{before}" if before else here
    return {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}


def _end(code: int) -> str:
    """Tell how a process ended that did not come to the end of its list."""
    if code >= 0:
        return f"the process that reads it ends with status {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"the process that reads it ends by {name}"
