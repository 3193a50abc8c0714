"""Files from elsewhere are opened by another process first, which may crash, hang or run out of memory.

The library of HDF5 trusts what a file says of itself: a few wrong bytes can make it write where it must not,
or never come to an end. That process reads what the library has to interpret, under limits of time and
memory; what it gets through, this one can read as well.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing, suppress
from importlib import import_module
from itertools import compress
from pathlib import Path

from fit.errors import InputError
from fit.files import is_file

MEMORY = 2**32  # bytes
PATIENCE = 60.0  # s
_PACE = 2e7  # bytes per s that are read at least

Look = Callable[..., object]


def check(look: Look, paths: Sequence[Path], arguments: Mapping[Path, object] | None = None) -> None:
    """Refuse files that cannot be read, or not within the limits, as `passed`."""
    for _ in passed(look, paths, arguments):
        pass


def passed(
    look: Look, paths: Sequence[Path], arguments: Mapping[Path, object] | None = None
) -> Generator[Path]:
    """Yield files as the other process gets through them.

    Parameters
    ----------
    look : callable
        Reads what has to be interpreted of a file, ``look(path)``, and raises `InputError` if it is at fault.
        A function of a module, as the other process finds it by its name.
    paths : sequence of Path
        The files. What is no file is left to whoever opens it.
    arguments : mapping of Path to str, int or None, optional
        A second argument of `look` for each.

    Raises
    ------
    InputError
        For the first that cannot be read, or not within the limits.
    """
    tried = [is_file(path) for path in paths]
    with closing(refusals(look, [*compress(paths, tried)], arguments)) as messages:
        for path, is_tried in zip(paths, tried, strict=True):
            refused = next(messages) if is_tried else None
            if refused is not None:
                raise InputError(refused)
            yield path


def refusals(
    look: Look, files: Sequence[Path], arguments: Mapping[Path, object] | None = None
) -> Generator[str | None]:
    """Yield why files are refused, None for sound ones, as far as the first that ends the process."""
    if not files:
        return
    allowance = PATIENCE + sum(path.stat().st_size for path in files) / _PACE
    calls = [[str(path), *([] if arguments is None else [arguments[path]])] for path in files]
    task = {"module": look.__module__, "name": look.__name__, "memory": MEMORY, "calls": calls}
    n_answers, late = 0, threading.Event()
    with _process() as process:
        assert process.stdin is not None and process.stdout is not None

        def is_late() -> None:
            if process.poll() is None:
                late.set()
                process.kill()

        end = threading.Timer(allowance, is_late)
        end.daemon = True
        end.start()
        try:
            with suppress(OSError), process.stdin as its:
                its.write(json.dumps(task).encode())
            for line in process.stdout:
                if line.endswith((b"}\n", b"}\r\n")):
                    yield json.loads(line)["refused"]
                    n_answers += 1
            code = process.wait()
        finally:
            end.cancel()
            process.kill()  # if nobody listens any more
    if n_answers < len(files):
        outcome = f"is not done with in {allowance:.0f} s" if late.is_set() else _end(code)
        yield f"{files[n_answers]}: damaged: {outcome}, expected a file that can be read"


def _process() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=_environment(),
    )


def _environment() -> Mapping[str, str]:
    root = str(Path(__file__).parents[2])
    python_path = os.environ.get("PYTHONPATH")
    path = f"{root}{os.pathsep}{python_path}" if python_path else root
    return {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}


def _end(code: int) -> str:
    """Tell how a process ended that did not come to the end of its list."""
    if code >= 0:
        return f"the process that reads it ends with status {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"the process that reads it ends by {name}"


# In the other process ----------------------------------------------------------------------------------


def serve() -> None:
    """Take a list of files from standard input; write a line of JSON for each, `refused` with why or null."""
    task = json.load(sys.stdin)
    _limit(task["memory"])
    look: Look = getattr(import_module(task["module"]), task["name"])
    for name, *arguments in task["calls"]:
        path, refused = Path(name), None
        try:
            look(path, *arguments)
        except InputError as error:
            refused = str(error)
        except MemoryError:
            refused = f"{path}: takes more than {task['memory']} bytes of memory to be read, expected less"
        print(json.dumps({"refused": refused}), flush=True)


def _limit(memory: int) -> None:
    """Let this process take no more memory than that, write no file and leave no trace of a crash."""
    with suppress(ImportError, OSError, ValueError):  # where there are no such limits
        import resource

        for limit, value in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_FSIZE, 0),
            (resource.RLIMIT_AS, memory),
        ):
            resource.setrlimit(limit, (value, value))
