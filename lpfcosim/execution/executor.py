"""Executors of tasks: processes of this machine, or a Dask cluster; the results are the same.

A process that crashes, hangs or is killed fails its task and no other.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pebble import ProcessExpired, ProcessPool

from fit.parallel import processors
from lpfcosim.errors import RunError
from lpfcosim.execution import checksums, dask_executor, forkserver, workers

SILENCE = 60.0  # s without a step, after which an FMU is taken to hang

_POLL = 0.2  # s between two looks at the tasks
_ABSENCE = 1.0  # s, after which a process has ended by itself: pebble reports all but status 0
_NO_PROCESS = "no process can be started, or all were killed (out of memory?)"
_CRASHES = ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV", "SIGSYS", "SIGTRAP")


@dataclass
class _RunningTask:
    """A task that a worker has, as this process sees it; durations in s."""

    name: str
    slot: workers.Slot
    position: tuple[int, int] = (0, 0)
    silence: float = 0.0
    absence: float = 0.0  # of its process
    error: RunError | None = None

    def update(self, elapsed: float, processes: set[int | None]) -> None:
        """Note that a time has passed, and which processes there are."""
        progress = self.slot.progress
        position = (progress.sample, progress.component)
        is_silent = position == self.position and not progress.is_idle
        self.silence = self.silence + elapsed if is_silent else 0.0
        self.position = position
        is_absent = self.slot.process and self.slot.process not in processes
        self.absence = self.absence + elapsed if is_absent else 0.0


@dataclass(frozen=True)
class Executor:
    """Where tasks are done, and within which limits.

    Attributes
    ----------
    jobs : int, optional
        Number of processes; as many as there are processors by default.
    scheduler : str, optional
        Address of the scheduler of a Dask cluster, which then does the work.
    time_limit : float, optional
        Longest that a task may take in a process of this machine [s].
    silence : float
        Time without a step after which an FMU is taken to hang there [s].
    """

    jobs: int | None = None
    scheduler: str | None = None
    time_limit: float | None = None
    silence: float = SILENCE

    def results(
        self,
        config: workers.WorkerConfig,
        items: Mapping[str, object],
        fmus: Mapping[str, Path],
        on_progress: Callable[[str, int], None] = lambda _name, _samples: None,
    ) -> Generator[tuple[str, Any]]:
        """Yield name and result of every task as they are done; closing the generator ends them.

        Parameters
        ----------
        config : WorkerConfig
            What to do.
        items : mapping of str to object
            By name, in the order in which tasks are to be started.
        fmus : mapping of str to Path
            Handed to all tasks.
        on_progress : callable
            Called with the name of a task and its number of samples done, on this machine.

        Yields
        ------
        (str, object)
            The object is what the function returned, or an `InputError` or `RunError`.

        Raises
        ------
        InputError
            If there is no such cluster, or Dask is not installed.
        RunError
            If no process can be started, or the scheduler is lost.
        """
        if not items:
            return
        if self.scheduler:
            yield from dask_executor.results(self.scheduler, config.function, items, fmus)
            return
        n_workers = min(self.jobs or processors(), len(items))
        context = forkserver.context()
        slots = context.RawArray(workers.Slot, len(items))
        with suppress(OSError):  # without a folder there are no logs
            config.logs.mkdir(parents=True, exist_ok=True)
        with checksums.temporary_folder(config.folder) as scratch:
            state = (config, fmus, slots, scratch, dict(os.environ))
            pool = ProcessPool(n_workers, initializer=workers.initialize, initargs=state, context=context)
            tasks = [_RunningTask(name, slot) for name, slot in zip(items, slots, strict=True)]
            try:
                yield from self._in_processes(pool, config, items, tasks, n_workers, on_progress)
            finally:
                pool.stop()
                pool.join()
                checksums.remove_partial(config.folder)
                config.remove_empty_logs()

    def _in_processes(
        self,
        pool: ProcessPool,
        config: workers.WorkerConfig,
        items: Mapping[str, object],
        tasks: Sequence[_RunningTask],
        n_workers: int,
        on_progress: Callable[[str, int], None],
    ) -> Generator[tuple[str, Any]]:
        """Keep all workers busy; cancel tasks beyond their limits; yield what comes of each."""
        queue = deque(enumerate(tasks))
        running: dict[Future[Any], _RunningTask] = {}
        clock = time.monotonic()
        while queue or running:
            while queue and len(running) < n_workers:
                position, task = queue.popleft()
                task.slot.progress.set_idle()  # a process that is still starting is not silent
                arguments = (task.name, position, items[task.name])
                try:
                    future = pool.schedule(workers.execute, arguments, timeout=self.time_limit)
                except RuntimeError:
                    raise RunError(_NO_PROCESS) from None
                running[future] = task
            processes = {process.pid for process in multiprocessing.active_children()}
            done, _ = wait(running, _POLL, FIRST_COMPLETED)
            # While a machine or a process group was stopped, no task was silent.
            elapsed = min(time.monotonic() - clock, 5 * _POLL)
            clock = time.monotonic()
            for future, task in running.items():
                if future in done or task.error:
                    continue
                task.update(elapsed, processes)
                if task.silence > self.silence:
                    cause = f"does not return (nothing was done for {self.silence:g} s)"
                elif task.absence > _ABSENCE:
                    cause = "ended the process with status 0"
                else:
                    on_progress(task.name, max(task.slot.progress.sample, 0))
                    continue
                task.error = config.failure(task.name, task.slot.progress, cause, is_fmu=True)
                future.cancel()  # ends the process
            for future in done:
                task = running.pop(future)
                yield task.name, self._outcome(future, task, config)

    def _outcome(self, future: Future[Any], task: _RunningTask, config: workers.WorkerConfig) -> Any:
        try:
            return future.result()
        except CancelledError:
            return task.error
        except BrokenProcessPool:
            raise RunError(_NO_PROCESS) from None
        except TimeoutError:
            cause, is_fmu = f"was ended at its time limit of {self.time_limit:g} s", False
        except ProcessExpired as error:
            cause, is_fmu = _describe_exit(error.exitcode)
        return config.failure(task.name, task.slot.progress, cause, is_fmu=is_fmu)


def _describe_exit(code: int) -> tuple[str, bool]:
    """Describe how a process ended; return also whether its FMU is to blame."""
    if code >= 0:
        return f"ended the process with status {code if code < 256 else hex(code)}", True
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    if name in _CRASHES:
        return f"crashed ({name}, {signal.strsignal(-code)})", True
    return f"was killed ({name}{'; out of memory?' if name == 'SIGKILL' else ''})", False
