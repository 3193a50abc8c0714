"""Processes for native code: one that crashes, hangs or is killed fails its task and no other."""

from __future__ import annotations

import ctypes
import faulthandler
import logging
import multiprocessing as mp
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, TextIO

from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import LpfcosimError, RunError
from lpfcosim.execution import checksums, forkserver

SILENCE = 60.0  # s without a step, after which an FMU is taken to hang

_POLL = 0.2  # s between two looks at the workers
_MESSAGES = 1000  # of FMUs that a log takes
_UNKNOWN = 255  # what the standard library says of a process whose server cannot tell any more
_SERVER_LOST = "the process that starts the others was killed (out of memory?)"
_CRASHES = ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV", "SIGSYS", "SIGTRAP")


@dataclass(frozen=True)
class WorkerFailure:
    """How a task ended that could not say so itself.

    Attributes
    ----------
    how : str
        Goes behind "the FMU" or "its process": ``crashed (SIGSEGV, Segmentation fault)``.
    slave, sample : int
        As `SimulationProgress` had them; ``slave`` is -1 too if no FMU is to blame.
    """

    how: str
    slave: int
    sample: int


@dataclass(frozen=True)
class WorkerConfig:
    """What all workers share.

    Attributes
    ----------
    function : callable
        Does a task as ``function(*item, where)``. A `LpfcosimError` that it raises is its result.
    folder : Path
        Where tasks write; what a lost process did not finish is removed from there
        (`checksums.remove_partial`).
    logs : Path
        Folder of what tasks say: ``NAME.log`` has what FMUs report, what is written to standard output and
        error, and where a process crashed. Those that say nothing leave none.
    called : str
        What a task is called in a sentence about it.
    """

    function: Callable[..., Any]
    folder: Path
    logs: Path
    called: str = "run '{}'"

    def log(self, name: str) -> Path:
        """Path of the log of a task."""
        return self.logs / f"{name}.log"

    def tidy(self) -> None:
        """Remove the folder of logs unless something stands in it."""
        with suppress(OSError):
            for log in self.logs.glob("*.log"):
                if not log.stat().st_size:
                    log.unlink()
            self.logs.rmdir()

    def note(self, name: str, line: str) -> None:
        """Add a line to the log of a task."""
        with suppress(OSError), self.log(name).open("a", encoding="utf-8") as log:
            log.write(f"{line}\n")


def results(
    setting: WorkerConfig,
    items: Mapping[str, tuple[Any, ...]],
    jobs: int,
    *,
    time_limit: float | None = None,
    silence: float = SILENCE,
    progress: Callable[[str, int], None] = lambda _name, _done: None,
) -> Generator[tuple[str, Any]]:
    """Yield name and result of every task as they come; whoever stops listening ends them all.

    Parameters
    ----------
    setting : WorkerConfig
        What to do.
    items : mapping of str to tuple
        Tasks by name, in the order in which they are to be begun.
    jobs : int
        Number of processes.
    time_limit : float, optional
        Longest that a task may take [s].
    silence : float
        Longest that `SimulationProgress` may stay as it is [s], unless it rests.
    progress : callable
        Told the name of a task and how many samples are done.

    Yields
    ------
    (str, object)
        The object is what the function returned, the `LpfcosimError` it raised, or `WorkerFailure`.

    Raises
    ------
    RunError
        If the server of the `forkserver` is killed, which takes the workers along.
    """
    waiting = deque(items.items())
    with _team(setting, min(jobs, len(items))) as (team, hire):
        for worker in team:
            worker.begin(*waiting.popleft())
        looked = time.monotonic()
        while busy := [w for w in team if w.task]:
            wait([h for w in busy for h in w.handles], _POLL)
            # A machine or process group that was stopped meanwhile did not keep anybody waiting.
            passed = min(time.monotonic() - looked, 5 * _POLL)
            looked = time.monotonic()
            for place, worker in [(k, w) for k, w in enumerate(team) if w.task]:
                task, done = worker.task, worker.look(passed, time_limit, silence)
                if done is None:
                    progress(task, max(worker.where.sample, 0))
                    continue
                (result,) = done
                if isinstance(result, WorkerFailure | LpfcosimError):
                    worker.end()  # who knows in what state
                    if waiting:
                        team[place] = hire()
                if waiting:
                    team[place].begin(*waiting.popleft())
                yield task, result


@contextmanager
def _team(setting: WorkerConfig, n: int) -> Iterator[tuple[list[_Worker], Callable[[], _Worker]]]:
    """Hire `n` workers; those in the list at the end are ended. Yields it, and how to hire another."""
    with checksums.temporary_folder(setting.folder) as scratch:
        with suppress(OSError):  # a worker without a log says less
            setting.logs.mkdir(parents=True, exist_ok=True)
        team: list[_Worker] = []
        try:
            team.extend(_Worker(setting, scratch) for _ in range(n))
            yield team, lambda: _Worker(setting, scratch)
        finally:
            for worker in team:
                worker.end()
            setting.tidy()


class _Worker:
    """A process and the task it is at; ``""`` if it has none."""

    def __init__(self, setting: WorkerConfig, scratch: Path) -> None:
        context = forkserver.context()
        self.where: SimulationProgress = context.RawValue(SimulationProgress)
        self.task = ""
        self._folder = setting.folder
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(setting, theirs, self.where, scratch, dict(os.environ))
        )
        try:
            with forkserver.interrupts_held():
                self._process.start()
        except (EOFError, ConnectionError):
            raise RunError("a process cannot be started (out of memory?)") from None
        theirs.close()

    @property
    def handles(self) -> tuple[Connection, int]:
        """What becomes ready when there is something to look at."""
        return self._pipe, self._process.sentinel

    def begin(self, task: str, item: tuple[Any, ...]) -> None:
        """Hand out a task."""
        self.task = task
        self.where.rest()  # a process that is still starting keeps no FMU silent
        self._seen = (self.where.sample, self.where.slave)
        self._taken = self._silent = 0.0
        with suppress(OSError):  # that the process is gone is noticed by the next look
            self._pipe.send((task, item))

    def look(self, passed: float, time_limit: float | None, silence: float) -> tuple[Any] | None:
        """Return the result in a tuple of its own, or None; ``passed``: time since the last look [s]."""
        died = not self._process.is_alive()  # in this order, as it may have sent its result before
        try:
            if self._pipe.poll():
                result = self._pipe.recv()
                self.task = ""
                return (result,)
        except (EOFError, OSError):
            self._process.join(1.0)
            died = True
        if died:
            if self._process.exitcode == _UNKNOWN and not self._gone():
                raise RunError(_SERVER_LOST)
            return (self._lost(*_told(self._process.exitcode)),)
        seen = (self.where.sample, self.where.slave)
        self._silent = self._silent + passed if seen == self._seen and not self.where.rests else 0.0
        self._taken += passed
        self._seen = seen
        if self._silent > silence:
            return (self._lost(f"hangs (nothing was done for {silence:g} s)", by_fmu=True),)
        if time_limit is not None and self._taken > time_limit:
            return (self._lost(f"was ended at its time limit of {time_limit:g} s", by_fmu=False),)
        return None

    def _lost(self, how: str, by_fmu: bool) -> WorkerFailure:
        self.task = ""
        return WorkerFailure(how, self.where.slave if by_fmu else -1, self.where.sample)

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        if self._process.exitcode == _UNKNOWN and self._process.pid and not self._gone():
            with suppress(ProcessLookupError):
                os.kill(self._process.pid, signal.SIGKILL)
            self._gone(wait=1.0)
        self._pipe.close()
        if self._process.pid is not None:
            checksums.remove_partial(self._folder, self._process.pid)

    def _gone(self, wait: float = 0.0) -> bool:
        """Tell whether the process has ended, within a time [s]: nobody holds its end of the pipe then."""
        try:
            while self._pipe.poll(wait):
                self._pipe.recv()
        except (EOFError, OSError):
            return True
        return False


def _told(code: int | None) -> tuple[str, bool]:
    """Tell how a process came to its end, and whether that is the doing of its FMU."""
    if code is None:
        return "does not answer", False
    if code >= 0:
        return f"ended the process with status {code if code < 256 else hex(code)}", True
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    if name in _CRASHES:
        return f"crashed ({name}, {signal.strsignal(-code)})", True
    return f"was killed ({name}{'; out of memory?' if name == 'SIGKILL' else ''})", False


# In a worker -------------------------------------------------------------------------------------------


def _serve(
    setting: WorkerConfig,
    pipe: Connection,
    where: SimulationProgress,
    scratch: Path,
    environment: Mapping[str, str],
) -> None:
    os.environ.clear()  # that of an earlier command, where a server has forked this process
    os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tempfile.tempdir = str(scratch)
    with suppress(OSError):  # Linux: when memory runs out, this process goes first
        Path("/proc/self/oom_score_adj").write_text("1000")
    end = threading.Thread(target=_end_with_parent, args=(setting, scratch), daemon=True)
    end.start()
    try:
        while True:
            name, item = pipe.recv()
            where.reset()
            with _logged(setting.log(name)):
                result = _done(setting, name, item, where)
            pipe.send(result)
    except EOFError:
        return
    except OSError:  # the parent is gone, and so shall be what it did not take
        end.join()


def _done(setting: WorkerConfig, name: str, item: tuple[Any, ...], where: SimulationProgress) -> Any:
    try:
        return setting.function(*item, where)
    except LpfcosimError as error:
        return error
    except MemoryError:
        return RunError(f"{setting.called.format(name)} failed: out of memory")
    except Exception as error:
        logging.getLogger(__name__).exception("in a worker")
        log = f"{setting.logs.name}/{setting.log(name).name}"
        cause = "internal error of lpfcosim, please report it with the traceback"
        if isinstance(error, OSError) and error.strerror:  # a disk or a file rather than a fault of ours
            cause = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        return RunError(f"{setting.called.format(name)} failed: {cause}; see {log}")


@contextmanager
def _logged(path: Path) -> Iterator[None]:
    """Send to a file what is said in this process, by Python or by native code; an empty one goes."""
    with Path(os.devnull).open("w", encoding="utf-8") as nothing:
        _redirect(nothing)
        with suppress(OSError), path.open("w", encoding="utf-8") as log:
            _redirect(log)  # a full disk will be told by who writes what matters
        faulthandler.enable()
        logging.basicConfig(format="%(message)s", level=logging.INFO, force=True)
        limit = _Limit()
        logging.getLogger().handlers[0].addFilter(limit)
        yield
        limit.close()
        sys.stdout.flush()
        with suppress(Exception):  # what C keeps in its buffers, where the C library can be asked
            ctypes.CDLL(None).fflush(None)
        _redirect(nothing)
    with suppress(OSError):
        if path.stat().st_size == 0:
            path.unlink()


def _redirect(file: TextIO) -> None:
    for stream in (1, 2):
        os.dup2(file.fileno(), stream)


class _Limit(logging.Filter):
    """Lets so many messages through that an FMU that complains at every step does not fill the disk.

    `left` counts down, below zero those that were not let through.
    """

    left = _MESSAGES

    def filter(self, _: logging.LogRecord) -> bool:
        self.left -= 1
        return self.left >= 0

    def close(self) -> None:
        """Count in the log what was not let through."""
        if self.left < 0:
            print(f"(and {-self.left} more messages)", file=sys.stderr)


def _end_with_parent(setting: WorkerConfig, scratch: Path) -> None:
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
        checksums.remove_partial(setting.folder, os.getpid())
        # This worker may be unpacking just now, and another one removing.
        for _ in range(50):
            shutil.rmtree(scratch, ignore_errors=True)
            if not scratch.exists():
                break
            time.sleep(0.02)
        os._exit(1)
