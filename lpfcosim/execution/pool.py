"""Tasks shared among worker processes, or given to any executor of `concurrent.futures`; the results agree.

A worker is a process of its own (`worker`), which imports nothing of the caller, so that a call works alike
in a script, a notebook and a thread. One that crashes or is killed fails its task and no other.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, cast

from fit.parallel import processors
from lpfcosim.cosim import SimulationProgress
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import checksums, worker
from lpfcosim.spacecraft import H

START = 60.0  # s that a worker may take to start
_POLL = 0.2  # s between two looks at the workers
_ROOT = Path(__file__).parents[2]
_PROGRAM = f"import sys; sys.path[:] = sys.argv[2:]; from {worker.__name__} import main; main(sys.argv[1])"
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Tasks:
    """What is to be done.

    Attributes
    ----------
    function : callable
        ``function(item, progress)``, of a module that workers can import; `worker.execute` calls it.
    items : mapping of str to object
        By name, in the order in which they are to be started.
    folder : Path
        Where tasks write. What is not finished at the end is removed (`checksums.remove_partial`).
    logs : Path
        Folder of the logs ``NAME.log`` of worker processes: messages of FMUs, standard output and error, the
        traceback of a crash. Empty logs are removed.
    label : str
        How messages name a task.
    models : tuple of str
        The FMUs by `SimulationProgress.component`, to name one that fails.
    """

    function: Callable[[Any, SimulationProgress], Any]
    items: Mapping[str, Any]
    folder: Path
    logs: Path
    label: str = "run '{}'"
    models: tuple[str, ...] = ()

    def remove_empty_logs(self) -> None:
        """Remove empty logs, and their folder if nothing is left in it."""
        with suppress(OSError):
            for log in self.logs.glob("*.log"):
                if not log.stat().st_size:
                    log.unlink()
            self.logs.rmdir()

    def append_to_log(self, name: str, text: str) -> None:
        """Add a line to the log of a task."""
        with suppress(OSError), (self.logs / f"{name}.log").open("a", encoding="utf-8") as log:
            log.write(f"{text}\n")


@dataclass(frozen=True)
class Workers:
    """Who does the work, and within which limit.

    Attributes
    ----------
    jobs : int, optional
        Number of worker processes; as many as there are processors by default.
    executor : concurrent.futures.Executor, optional
        Does the work instead, in processes that have this package and the same file system.
    time_limit : float, optional
        Longest that a task may take in a worker process [s].
    """

    jobs: int | None = None
    executor: Executor | None = None
    time_limit: float | None = None

    def __post_init__(self) -> None:
        if self.jobs is not None and not (isinstance(self.jobs, int) and self.jobs >= 1):
            raise InputError(f"jobs: {self.jobs!r}, expected one or more processes")
        is_time = isinstance(self.time_limit, int | float) and self.time_limit > 0
        if self.time_limit is not None and not is_time:
            raise InputError(f"time_limit: {self.time_limit!r}, expected a time in s")

    def results(
        self, tasks: Tasks, on_progress: Callable[[str, SimulationProgress], None] = lambda _name, _now: None
    ) -> Generator[tuple[str, Any]]:
        """Yield name and result of every task as they are done; closing the generator ends them.

        Parameters
        ----------
        tasks : Tasks
            What to do.
        on_progress : callable
            Called with the name of a task of a worker process, and how far it is.

        Yields
        ------
        (str, object)
            The object is what the function returned, or an `InputError` or `RunError`.

        Raises
        ------
        RunError
            If no worker process can be started.
        """
        if not tasks.items:
            return
        try:
            if self.executor is not None:
                yield from _on_executor(self.executor, tasks)
                return
            n_workers = min(self.jobs or processors(), len(tasks.items))
            with suppress(OSError):  # without a folder there are no logs
                tasks.logs.mkdir(parents=True, exist_ok=True)
            with (
                checksums.temporary_folder(tasks.folder) as scratch,
                closing(_Pool(tasks, n_workers, scratch, self.time_limit or inf)) as pool,
            ):
                yield from pool.results(on_progress)
        finally:
            checksums.remove_partial(tasks.folder)
            tasks.remove_empty_logs()


def _on_executor(executor: Executor, tasks: Tasks) -> Generator[tuple[str, Any]]:
    function = worker.with_versions(tasks.function)
    try:
        names = {executor.submit(worker.execute, function, item): name for name, item in tasks.items.items()}
    except RuntimeError as error:  # it was shut down
        raise RunError(f"{type(executor).__name__}: {error}") from error
    try:
        for future in as_completed(names):
            outcome: Any
            try:
                outcome = future.result()
            except (InputError, RunError) as error:
                outcome = error
            except Exception as error:  # of a worker or the executor, or a future that was cancelled
                reason = " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split())[:200]
                outcome = RunError(f"{tasks.label.format(names[future])} failed: {reason}")
            yield names[future], outcome
    finally:
        for future in names:
            future.cancel()


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask cluster, which repeats the tasks of a worker that is lost.

    Parameters
    ----------
    address : str
        Of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        If Dask is not installed, or no scheduler answers.
    """
    try:
        from distributed import Client

        client = Client(address, timeout=10, set_as_default=False)
    except ModuleNotFoundError:
        raise InputError("scheduler: needs Dask, install lpfcosim[dask]") from None
    except (OSError, ValueError, RuntimeError, TypeError):
        raise InputError(
            f"scheduler: {address}: no Dask scheduler answers, expected tcp://HOST:8786"
        ) from None
    with client:
        yield cast("Executor", client.get_executor(pure=False))


class _Worker:
    """A worker process with its pipes and the file in which it keeps its progress.

    Attributes
    ----------
    deadline : float
        Time by `time.monotonic` when it is to be killed.
    is_late : bool
        Whether it was.
    """

    def __init__(self, scratch: Path) -> None:
        place = Path(tempfile.mkdtemp(dir=scratch))
        self._progress, self._messages = place / "progress", place / "messages"
        self._progress.write_bytes(bytes(SimulationProgress()))
        self.deadline, self.is_late, self._is_killed = time.monotonic() + START, False, False
        temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(scratch))
        with self._messages.open("wb") as messages:
            self.popen = subprocess.Popen(
                [sys.executable, "-P", "-c", _PROGRAM, self._progress, *sys.path, _ROOT],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=messages,
                env={**os.environ, **_ONE_THREAD, **temporary},
                process_group=0,
            )

    @property
    def progress(self) -> SimulationProgress:
        return SimulationProgress.from_buffer_copy(self._progress.read_bytes())

    @property
    def message(self) -> str:
        """What the process has last printed outside of a task."""
        return self._messages.read_text(encoding="utf-8", errors="replace").strip().split("\n")[-1]

    def outcome(self, task: bytes = b"") -> Any:
        """Wait for what comes of a task, or until the process is ready; EOFError if it ends."""
        assert self.popen.stdin and self.popen.stdout
        try:
            if task:
                pickle.dump(task, self.popen.stdin)
                self.popen.stdin.flush()
            content: bytes = pickle.load(self.popen.stdout)
        except (OSError, pickle.UnpicklingError):
            raise EOFError from None
        return pickle.loads(content)

    def check(self) -> None:
        """Kill the process if it is late, and what it has started if it has ended.

        A child that an FMU forked has the pipe as well, which does not end before it does.
        """
        if self.popen.poll() is not None:
            self.kill()
        elif time.monotonic() > self.deadline:
            self.is_late = True
            self.kill()

    def kill(self) -> None:
        """End the process and its children, once, as others may have its number later."""
        if not self._is_killed:
            self._is_killed = True
            self.popen.kill()
            with suppress(OSError, AttributeError):  # of systems without groups of processes
                os.killpg(self.popen.pid, signal.SIGKILL)


class _Pool:
    """Worker processes, and a thread for each that hands it tasks and waits for the results."""

    def __init__(self, tasks: Tasks, n_workers: int, scratch: Path, time_limit: float) -> None:
        self._tasks, self._scratch, self._time_limit = tasks, scratch, time_limit
        self._function = worker.with_versions(tasks.function)
        self._threads = ThreadPoolExecutor(n_workers)
        self._n_workers = n_workers
        self._pending = deque(tasks.items)
        self._outcomes = SimpleQueue[tuple[str, Any]]()
        self._workers: list[_Worker] = []
        self._running: dict[str, _Worker] = {}

    def results(self, on_progress: Callable[[str, SimulationProgress], None]) -> Generator[tuple[str, Any]]:
        ends = [self._threads.submit(self._work) for _ in range(self._n_workers)]
        n_outcomes = 0
        while n_outcomes < len(self._tasks.items):
            for process in self._workers:
                process.check()
            for name, process in self._running.copy().items():
                on_progress(name, process.progress)
            all_ended = all(end.done() for end in ends)
            with suppress(Empty):
                yield self._outcomes.get(timeout=0 if all_ended else _POLL)
                n_outcomes += 1
                continue
            if all_ended:
                raise next(error for end in ends if (error := end.exception()))

    def close(self) -> None:
        """End all processes."""
        self._pending.clear()
        for process in self._workers:
            process.kill()
        self._threads.shutdown(cancel_futures=True)
        for process in self._workers:
            process.kill()  # one that was being started
            with suppress(OSError), process.popen:  # closes the pipes
                pass

    def _work(self) -> None:
        """Have tasks done by a process, and by another one if that ends, while there are any; in a thread."""
        process: _Worker | None = None
        while self._pending:
            if process is None or process.popen.poll() is not None:
                process = self._started()
            try:
                name = self._pending.popleft()
            except IndexError:  # another thread was faster
                return
            self._outcomes.put((name, self._outcome(name, process)))

    def _outcome(self, name: str, process: _Worker) -> Any:
        label, log = self._tasks.label.format(name), self._tasks.logs / f"{name}.log"
        try:
            task = worker.pickled((self._function, self._tasks.items[name], label, log))
        except RunError as error:
            return RunError(f"{label} failed: {error}")
        process.deadline = time.monotonic() + self._time_limit
        self._running[name] = process
        try:
            return process.outcome(task)
        except EOFError:
            return self._failure(label, process)
        finally:
            process.deadline = inf
            del self._running[name]

    def _started(self) -> _Worker:
        """Return a new process that is ready; RunError if there can be none."""
        reason: object
        try:
            process = _Worker(self._scratch)
            self._workers.append(process)
            process.outcome()
        except OSError as error:
            reason = error.strerror or error
        except EOFError:
            ending = f"no answer within {START:g} s" if process.is_late else _ending(process.popen.wait())
            reason = process.message or ending
        else:
            process.deadline = inf
            return process
        raise RunError(f"no worker process can be started ({sys.executable}): {reason}")

    def _failure(self, label: str, process: _Worker) -> RunError:
        """Return the error of a task whose process ended, or was ended."""
        ending, progress = _ending(process.popen.wait()), process.progress
        if process.is_late:
            ending = f"was ended at its time limit of {self._time_limit:g} s"
        moment = " while the FMUs were loaded" if progress.is_loading else ""
        if progress.sample >= 0:
            moment = f" at {progress.sample * H:.1f} s"
        place = f", in the {self._tasks.models[progress.component]} FMU" if progress.component >= 0 else ""
        return RunError(f"{label}: its process {ending}{moment}{place}")


def _ending(code: int) -> str:
    """Describe how a process ended."""
    if code >= 0:
        return f"ended with status {code if code < 256 else hex(code)}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"was ended by {name}{' (out of memory?)' if name == 'SIGKILL' else ''}"
