"""A worker process: does the tasks that come by standard input, and ends when that does, with the caller.

A message either way is pickled ``bytes``, which are a pickle themselves.
"""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import mmap
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from queue import SimpleQueue
from typing import Any, BinaryIO

from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError

Function = Callable[[Any, SimulationProgress], Any]
_PACKAGES = ("lpfcosim", "numpy", "scipy")  # on whose versions the last bits depend


def pickled(value: object) -> bytes:
    """Return what another process can be given; RunError if it can not."""
    try:
        return pickle.dumps(value)
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError) as error:
        raise RunError(f"cannot be handed to another process ({error})") from error


def with_versions(function: Function) -> bytes:
    """Return a function for `execute`, with the versions of the packages that it was made by."""
    return pickle.dumps((_versions(), pickled(function)))


def execute(function: bytes, item: object, progress: SimulationProgress | None = None) -> Any:
    """Call a function that `with_versions` returned, in a process of a pool or of any executor.

    The function is the same object in every task of a process, and can keep what they share.

    Raises
    ------
    RunError
        If a package has another version here.
    """
    progress = progress or SimulationProgress()
    progress.set_idle()
    with _SINGLE:  # FMUs and fits expect one thread
        return _load(function)(item, progress)


_SINGLE = threading.Lock()


@lru_cache(maxsize=1)
def _load(content: bytes) -> Function:
    versions, function = pickle.loads(content)
    for package, version in _versions().items():
        if version != versions[package]:
            raise RunError(f"a worker has {package} {version}, expected {versions[package]} as the caller")
    loaded: Function = pickle.loads(function)
    return loaded


def _versions() -> dict[str, str]:
    return {package: metadata.version(package) for package in _PACKAGES}


def main(progress_file: str) -> None:
    """Do tasks until there are no more.

    Parameters
    ----------
    progress_file : str
        The memory of a `SimulationProgress`, which the caller reads.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # to end the workers is up to the caller
    source, sink = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    messages = os.dup(2)
    faulthandler.enable()
    logging.basicConfig(format="%(message)s", level=logging.INFO)
    with suppress(OSError):  # Linux: when memory runs out, this process is ended before its parent
        Path("/proc/self/oom_score_adj").write_text("1000")
    with Path(progress_file).open("r+b") as file:
        progress = SimulationProgress.from_buffer(mmap.mmap(file.fileno(), 0))
    tasks = SimpleQueue[bytes]()
    threading.Thread(target=_receive, args=(source, tasks), daemon=True).start()
    outcome = pickled(None)  # the first one says that this process is ready
    while True:
        try:
            pickle.dump(outcome, sink)
            sink.flush()
        except OSError:  # the caller is gone
            os._exit(1)
        outcome = _outcome(progress, *pickle.loads(tasks.get()))
        sys.stdout.flush()
        with suppress(Exception):  # buffers of C, where the C library can be called
            ctypes.CDLL(None).fflush(None)
        _redirect(messages)


def _receive(source: BinaryIO, tasks: SimpleQueue[bytes]) -> None:
    """Hand on tasks while this process works; end it with the one that sends them."""
    with suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            tasks.put(pickle.load(source))
    os._exit(1)


def _redirect(descriptor: int) -> None:
    """Let standard output and error of this process, also of native code, go to a file."""
    for stream in (1, 2):
        os.dup2(descriptor, stream)


def _outcome(progress: SimulationProgress, function: bytes, item: object, label: str, log: Path) -> bytes:
    """Do a task; return the result, or the error that takes its place."""
    try:
        return pickled(_result(progress, function, item, label, log))
    except RunError as error:
        return pickled(RunError(f"{label} failed: its result {error}"))


def _result(progress: SimulationProgress, function: bytes, item: object, label: str, log: Path) -> Any:
    with suppress(OSError), log.open("wb") as file:  # a full disk is reported by who writes the telemetry
        _redirect(file.fileno())
    try:
        return execute(function, item, progress)
    except (InputError, RunError) as error:
        return error
    except MemoryError:
        return RunError(f"{label} failed: out of memory")
    except Exception as error:
        logging.getLogger(__name__).exception("in a worker")
        cause = "internal error of lpfcosim, please report it with the traceback"
        if isinstance(error, OSError) and error.strerror:  # of a disk or a file
            cause = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        return RunError(f"{label} failed: {cause}; see {log.parent.name}/{log.name}")
