"""Workers for native code: what tasks share, and what a process does with a task."""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import multiprocessing
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums
from lpfcosim.spacecraft import H

_MAX_MESSAGES = 1000  # of FMUs in a log
_POLL = 0.2  # s between two looks at the parent


@dataclass(frozen=True)
class WorkerConfig:
    """What all tasks share.

    Attributes
    ----------
    function : callable
        Does a task: ``function(item, fmus, progress)``. An `InputError` or `RunError` that it raises is its
        result. A cluster gets it once, not once for each item.
    folder : Path
        Where tasks write. What is not finished at the end is removed (`checksums.remove_partial`).
    logs : Path
        Folder of the logs ``NAME.log``: messages of FMUs, standard output and error, the traceback of a
        crash. Empty logs are removed.
    label : str
        How messages name a task.
    models : sequence of str
        The FMUs by `SimulationProgress.component`, to name one that fails.
    """

    function: Callable[[Any, Mapping[str, Path], SimulationProgress], Any]
    folder: Path
    logs: Path
    label: str = "run '{}'"
    models: tuple[str, ...] = ()

    def log(self, name: str) -> Path:
        """Path of the log of a task."""
        return self.logs / f"{name}.log"

    def remove_empty_logs(self) -> None:
        """Remove empty logs, and their folder if nothing is left in it."""
        with suppress(OSError):
            for log in self.logs.glob("*.log"):
                if not log.stat().st_size:
                    log.unlink()
            self.logs.rmdir()

    def append_to_log(self, name: str, line: str) -> None:
        """Add a line to the log of a task."""
        with suppress(OSError), self.log(name).open("a", encoding="utf-8") as log:
            log.write(f"{line}\n")

    def failure(self, name: str, progress: SimulationProgress, cause: str, *, is_fmu: bool) -> RunError:
        """Return the error of a task whose process ended, or was ended."""
        is_fmu = is_fmu and progress.component >= 0
        subject = f"the {self.models[progress.component]} FMU" if is_fmu else "its process"
        moment = f" at {progress.sample * H:.1f} s" if progress.sample >= 0 else ""
        if progress.is_loading:
            moment = " while the FMUs were loaded"
        return RunError(f"{self.label.format(name)}: {subject} {cause}{moment}")


class Slot(ctypes.Structure):
    """What a worker shares with this process about its task; `process` is 0 before it has begun."""

    _fields_ = (("progress", SimulationProgress), ("process", ctypes.c_int64))


# In a worker -------------------------------------------------------------------------------------------


@dataclass
class _Worker:
    """What the initializer of the pool hands to the tasks of a worker."""

    config: WorkerConfig
    fmus: Mapping[str, Path]
    slots: ctypes.Array[Slot]


_worker: _Worker


def initialize(
    config: WorkerConfig,
    fmus: Mapping[str, Path],
    slots: ctypes.Array[Slot],
    scratch: Path,
    environment: Mapping[str, str],
) -> None:
    """Prepare a process of the pool for its tasks."""
    global _worker
    _worker = _Worker(config, fmus, slots)
    os.environ.clear()  # that of an earlier command, if the server has served one
    os.environ.update(environment)
    tempfile.tempdir = str(scratch)
    with suppress(OSError):  # Linux: when memory runs out, this process is ended before its parent
        Path("/proc/self/oom_score_adj").write_text("1000")
    threading.Thread(target=_exit_with_parent, args=(config, scratch), daemon=True).start()


def execute(name: str, position: int, item: object) -> Any:
    """Do a task in a process of the pool; return the result, or the error that takes its place."""
    config, slot = _worker.config, _worker.slots[position]
    slot.progress.reset()
    slot.process = os.getpid()
    with _logged(config.log(name)):
        try:
            return config.function(item, _worker.fmus, slot.progress)
        except (InputError, RunError) as error:
            return error
        except MemoryError:
            return RunError(f"{config.label.format(name)} failed: out of memory")
        except Exception as error:
            logging.getLogger(__name__).exception("in a worker")
            log = f"{config.logs.name}/{config.log(name).name}"
            cause = "internal error of lpfcosim, please report it with the traceback"
            if isinstance(error, OSError) and error.strerror:  # of a disk or a file
                cause = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
            return RunError(f"{config.label.format(name)} failed: {cause}; see {log}")


@contextmanager
def _logged(path: Path) -> Iterator[None]:
    """Redirect standard output and error of this process, also of native code, to a file."""
    with Path(os.devnull).open("w", encoding="utf-8") as nothing:
        _redirect(nothing)
        with suppress(OSError), path.open("w", encoding="utf-8") as log:
            _redirect(log)  # a full disk is reported by who writes the telemetry
        faulthandler.enable()
        logging.basicConfig(format="%(message)s", level=logging.INFO, force=True)
        messages = _MessageLimit()
        logging.getLogger().handlers[0].addFilter(messages)
        yield
        messages.report_excess()
        sys.stdout.flush()
        with suppress(Exception):  # buffers of C, where the C library can be called
            ctypes.CDLL(None).fflush(None)
        _redirect(nothing)
    with suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()


def _redirect(file: TextIO) -> None:
    for stream in (1, 2):
        os.dup2(file.fileno(), stream)


class _MessageLimit(logging.Filter):
    """Limits the messages, so that an FMU with a complaint at every step does not fill the disk."""

    count = 0

    def filter(self, _: logging.LogRecord) -> bool:
        self.count += 1
        return self.count <= _MAX_MESSAGES

    def report_excess(self) -> None:
        """Print to the log how many messages are not in it."""
        if self.count > _MAX_MESSAGES:
            print(f"(and {self.count - _MAX_MESSAGES} more messages)", file=sys.stderr)


def _exit_with_parent(config: WorkerConfig, scratch: Path) -> None:
    """End this process when that of the command, or the server that forked this one, has ended.

    A command that was killed has left its folder for temporary files.
    """
    parent, server = multiprocessing.parent_process(), os.getppid()
    while parent is not None and parent.is_alive() and os.getppid() == server:
        time.sleep(_POLL)
    checksums.remove_partial(config.folder, os.getpid())
    if parent is not None and not parent.is_alive():
        for _ in range(50):  # while another worker unpacks or removes
            shutil.rmtree(scratch, ignore_errors=True)
            if not scratch.exists():
                break
            time.sleep(0.02)
    os._exit(1)
