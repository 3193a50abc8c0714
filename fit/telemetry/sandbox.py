"""A process that reads files from elsewhere first, which may crash, hang or run out of memory.

The library of HDF5 trusts what a file says of itself: of 600 files with a few wrong bytes one never comes to
an end, and others write where they must not. The process reads what the library has to interpret, under
limits of time and memory; what it gets through, this one can read as well.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from fit.errors import InputError
from fit.files import is_file

MEMORY = 2**32  # bytes
PATIENCE = 60.0  # s
_PACE = 2e7  # bytes per s that are read at least

Validator = Callable[..., object]


def check(validate: Validator, paths: Sequence[Path], *arguments: Sequence[object]) -> None:
    """Refuse files that cannot be read, or not within the limits; what is no file is not tried.

    See `rejections`.

    Raises
    ------
    InputError
        For the first of them.
    """
    calls = [call for call in zip(paths, *arguments, strict=True) if is_file(call[0])]
    for rejection in rejections(validate, *zip(*calls, strict=True)):
        if rejection is not None:
            raise InputError(rejection)


def rejections(
    validate: Validator, files: Sequence[Path] = (), *arguments: Sequence[object]
) -> list[str | None]:
    """Return why files are rejected, None for sound ones, up to the first that ends the process.

    Parameters
    ----------
    validate : callable
        Reads what has to be interpreted of a file, ``validate(path)``, and raises `InputError` if it is at
        fault. A function of a module: the process imports it by its name.
    files : sequence of Path
        The files.
    *arguments : sequence of str, int or None
        Further arguments of `validate`, one for each file.
    """
    if not files:
        return []
    limit = PATIENCE + sum(path.stat().st_size for path in files) / _PACE
    calls = list(zip(map(str, files), *arguments, strict=True))
    task = {"module": validate.__module__, "name": validate.__name__, "memory": MEMORY, "calls": calls}
    try:
        process = subprocess.run(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
            input=json.dumps(task).encode(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=_environment(),
            timeout=limit,
            check=False,
        )
        output, reason = process.stdout, _ending(process.returncode)
    except subprocess.TimeoutExpired as error:
        output, reason = error.stdout or b"", f"takes longer than {limit:.0f} s"
    lines = output.splitlines(keepends=True)
    answers = [json.loads(line)["rejection"] for line in lines if line.endswith(b"\n")]
    if len(answers) < len(files):
        damaged = f"{files[len(answers)]}: damaged: the process that reads it {reason}"
        answers.append(f"{damaged}, expected a file that can be read")
    return answers


def _environment() -> Mapping[str, str]:
    root = str(Path(__file__).parents[2])
    python_path = os.environ.get("PYTHONPATH")
    path = f"{root}{os.pathsep}{python_path}" if python_path else root
    return {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}


def _ending(code: int) -> str:
    """Describe how a process ended."""
    if code >= 0:
        return f"ends with status {code}"
    return f"ends by {signal.Signals(-code).name if -code in set(signal.Signals) else f'signal {-code}'}"


# In the other process ----------------------------------------------------------------------------------


def serve() -> None:
    """Read a task from standard input; write a line of JSON for each file, why it is rejected or null."""
    task = json.load(sys.stdin)
    _limit(task["memory"])
    validate: Validator = getattr(import_module(task["module"]), task["name"])
    for name, *arguments in task["calls"]:
        reason = rejection(validate, Path(name), *arguments, memory=task["memory"])
        print(json.dumps({"rejection": reason}), flush=True)


def rejection(validate: Validator, path: Path, *arguments: object, memory: int = MEMORY) -> str | None:
    """Return why a file is rejected, None for a sound one; it is read in this process."""
    try:
        validate(path, *arguments)
    except InputError as error:
        return str(error)
    except MemoryError:
        return f"{path}: takes more than {memory} bytes of memory to be read, expected less"
    except Exception as error:  # a library may raise anything
        reason = " ".join(str(error).split())
        return f"{path}: cannot be read ({reason}), expected a file that can be read"
    return None


def _limit(memory: int) -> None:
    """Let this process take no more memory than that, write no file and leave no trace of a crash."""
    with suppress(ImportError, OSError, ValueError):  # where there are no such limits
        import resource

        limits = {resource.RLIMIT_CORE: 0, resource.RLIMIT_FSIZE: 0, resource.RLIMIT_AS: memory}
        for limit, value in limits.items():
            resource.setrlimit(limit, (value, value))
