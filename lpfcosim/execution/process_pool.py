"""A pool of processes for native code: one that crashes, hangs or is killed fails its task and no other."""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import multiprocessing
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from pebble import ProcessExpired, ProcessPool

from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums, forkserver

SILENCE = 60.0  # s without a step, after which an FMU is taken to hang

_POLL = 0.2  # s between two looks at the tasks
_MAX_MESSAGES = 1000  # of FMUs in a log
_NO_PROCESS = "no process can be started, or all were killed (out of memory?)"
_CRASHES = ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV", "SIGSYS", "SIGTRAP")


@dataclass(frozen=True)
class WorkerFailure:
    """How a task ended whose process ended, or was ended.

    Attributes
    ----------
    description : str
        A predicate of "the FMU" or "its process", such as ``crashed (SIGSEGV, Segmentation fault)``.
    component, sample : int
        As of `SimulationProgress`; ``component`` is also -1 if no FMU is to blame.
    """

    description: str
    component: int
    sample: int


@dataclass(frozen=True)
class WorkerConfig:
    """What all tasks share.

    Attributes
    ----------
    function : callable
        Does a task: ``function(*arguments, progress)``. An `InputError` or `RunError` that it raises is its
        result.
    folder : Path
        Where tasks write. What is not finished at the end is removed (`checksums.remove_partial`).
    logs : Path
        Folder of the logs ``NAME.log``: messages of FMUs, standard output and error, the traceback of a
        crash. Empty logs are removed.
    label : str
        How messages name a task.
    """

    function: Callable[..., Any]
    folder: Path
    logs: Path
    label: str = "run '{}'"

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


@dataclass
class _RunningTask:
    """A task that a worker has, as this process sees it; durations in s."""

    name: str
    progress: SimulationProgress
    position: tuple[int, int] = (0, 0)
    duration: float = 0.0
    silence: float = 0.0
    failure: WorkerFailure | None = None

    def check_limits(self, elapsed: float, time_limit: float | None, silence: float) -> bool:
        """Note that a time has passed [s]; return whether the task is still within its limits."""
        position = (self.progress.sample, self.progress.component)
        is_silent = position == self.position and not self.progress.is_idle
        self.silence = self.silence + elapsed if is_silent else 0.0
        self.duration += elapsed
        self.position = position
        if self.silence > silence:
            description = f"does not return (nothing was done for {silence:g} s)"
            self.failure = WorkerFailure(description, position[1], position[0])
        elif time_limit is not None and self.duration > time_limit:
            description = f"was ended at its time limit of {time_limit:g} s"
            self.failure = WorkerFailure(description, -1, position[0])
        return self.failure is None

    def outcome(self, future: Future[Any]) -> Any:
        """Return what came of it: the result, an error or a `WorkerFailure`."""
        try:
            return future.result()
        except CancelledError:
            return self.failure
        except BrokenProcessPool:
            raise RunError(_NO_PROCESS) from None
        except ProcessExpired as error:
            description, is_fmu = _describe_exit(error.exitcode)
            component = self.progress.component if is_fmu else -1
            return WorkerFailure(description, component, self.progress.sample)


def results(
    config: WorkerConfig,
    tasks: Mapping[str, tuple[Any, ...]],
    jobs: int,
    *,
    time_limit: float | None = None,
    silence: float = SILENCE,
    on_progress: Callable[[str, int], None] = lambda _name, _samples: None,
) -> Generator[tuple[str, Any]]:
    """Yield name and result of every task as they are done; closing the generator ends all processes.

    Parameters
    ----------
    config : WorkerConfig
        What to do.
    tasks : mapping of str to tuple
        Arguments by name, in the order in which tasks are to be started.
    jobs : int
        Number of processes.
    time_limit : float, optional
        Longest that a task may take [s].
    silence : float
        Longest that the `SimulationProgress` of a task may stay the same [s], unless it is idle.
    on_progress : callable
        Called with the name of a task and its number of samples done.

    Yields
    ------
    (str, object)
        The object is what the function returned, the error it raised, or a `WorkerFailure`.

    Raises
    ------
    RunError
        If no process can be started.
    """
    n_workers = min(jobs, len(tasks))
    context = forkserver.context()
    slots = context.RawArray(SimulationProgress, len(tasks))
    with suppress(OSError):  # without a folder there are no logs
        config.logs.mkdir(parents=True, exist_ok=True)
    with checksums.temporary_folder(config.folder) as scratch:
        state = (config, slots, scratch, dict(os.environ))
        pool = ProcessPool(n_workers, initializer=_initialize, initargs=state, context=context)
        try:
            yield from _collect(pool, tasks, slots, n_workers, time_limit, silence, on_progress)
        finally:
            pool.stop()
            pool.join()
            checksums.remove_partial(config.folder)
            config.remove_empty_logs()


def _collect(
    pool: ProcessPool,
    tasks: Mapping[str, tuple[Any, ...]],
    slots: ctypes.Array[SimulationProgress],
    n_workers: int,
    time_limit: float | None,
    silence: float,
    on_progress: Callable[[str, int], None],
) -> Generator[tuple[str, Any]]:
    """Keep all workers busy; cancel tasks beyond their limits; yield what comes of each."""
    queue = deque(enumerate(tasks.items()))
    running: dict[Future[Any], _RunningTask] = {}
    clock = time.monotonic()
    while queue or running:
        while queue and len(running) < n_workers:
            slot, (name, arguments) = queue.popleft()
            slots[slot].set_idle()  # a process that is still starting is not silent
            try:
                future = pool.schedule(_execute, (name, slot, arguments))
            except RuntimeError:
                raise RunError(_NO_PROCESS) from None
            running[future] = _RunningTask(name, slots[slot])
        done, _ = wait(running, _POLL, FIRST_COMPLETED)
        # While a machine or a process group was stopped, no task was silent.
        elapsed = min(time.monotonic() - clock, 5 * _POLL)
        clock = time.monotonic()
        for future, task in running.items():
            if future in done or task.failure is not None:
                continue
            if task.check_limits(elapsed, time_limit, silence):
                on_progress(task.name, max(task.progress.sample, 0))
            else:
                future.cancel()  # ends the process
        for future in done:
            task = running.pop(future)
            yield task.name, task.outcome(future)


def _describe_exit(code: int) -> tuple[str, bool]:
    """Describe how a process ended; return also whether its FMU is to blame."""
    if code >= 0:
        return f"ended the process with status {code if code < 256 else hex(code)}", True
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    if name in _CRASHES:
        return f"crashed ({name}, {signal.strsignal(-code)})", True
    return f"was killed ({name}{'; out of memory?' if name == 'SIGKILL' else ''})", False


# In a worker -------------------------------------------------------------------------------------------


@dataclass
class _Worker:
    """What the initializer of the pool hands to the tasks of a worker."""

    config: WorkerConfig
    slots: ctypes.Array[SimulationProgress]


_worker: _Worker


def _initialize(
    config: WorkerConfig,
    slots: ctypes.Array[SimulationProgress],
    scratch: Path,
    environment: Mapping[str, str],
) -> None:
    global _worker
    _worker = _Worker(config, slots)
    os.environ.clear()  # that of an earlier command, if the server has served one
    os.environ.update(environment)
    tempfile.tempdir = str(scratch)
    with suppress(OSError):  # Linux: when memory runs out, this process is ended before its parent
        Path("/proc/self/oom_score_adj").write_text("1000")
    threading.Thread(target=_exit_with_parent, args=(config, scratch), daemon=True).start()


def _execute(name: str, slot: int, arguments: tuple[Any, ...]) -> Any:
    config, progress = _worker.config, _worker.slots[slot]
    progress.reset()
    with _logged(config.log(name)):
        try:
            return config.function(*arguments, progress)
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
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        checksums.remove_partial(config.folder, os.getpid())
        # This worker may be unpacking just now, and another one removing.
        for _ in range(50):
            shutil.rmtree(scratch, ignore_errors=True)
            if not scratch.exists():
                break
            time.sleep(0.02)
        os._exit(1)
