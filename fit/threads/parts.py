"""Threads share work that falls into parts, and parts that fall into parts.

Most of the time goes into operations on long arrays, during which Python lets other threads run. Who has
nothing left helps with the parts of a part that another one is still at: one long run among short ones would
keep everybody waiting.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import Generic, TypeVar

from fit.threads.progress import following, tell

_R = TypeVar("_R")
_T = TypeVar("_T")

_ALONE: ContextVar[bool] = ContextVar("_ALONE", default=False)
_AT_WORK: ContextVar[bool] = ContextVar("_AT_WORK", default=False)  # whether this is part of something


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def each(
    function: Callable[[_T], _R], items: Iterable[_T], size: Callable[[_T], float] | None = None
) -> list[_R]:
    """Return what a function makes of every item, in their order; threads share the work.

    What it raises for the first of them that fails is raised here. Whoever follows the work
    (`fit.threads.progress`) is told of every item. With `size`, threads begin with the largest, lest one is
    still at it when the others have nothing left.
    """
    work = list(items)
    if _ALONE.get() or processors() < 2:
        size = None
    turn = sorted(range(len(work)), key=lambda i: -size(work[i])) if size else range(len(work))
    return _Parts(function, work, turn).done()


@contextmanager
def alone() -> Iterator[None]:
    """Do everything in this thread, where other processes have the other processors."""
    token = _ALONE.set(True)
    try:
        yield
    finally:
        _ALONE.reset(token)


class _Crew:
    """The threads of this process that are at work."""

    def __init__(self) -> None:
        self._lock, self._size = threading.Lock(), 0

    def hire(self) -> bool:
        """Count another one, if a processor is free for it."""
        with self._lock:
            free = self._size < processors()
            self._size += free
            return free

    def change(self, by: int) -> None:
        """Count one that begins, or ends, whatever there is."""
        with self._lock:
            self._size += by


_CREW = _Crew()


class _Parts(Generic[_T, _R]):
    """Parts of some work, each taken by whoever is free: who asks for them, or helps."""

    def __init__(self, function: Callable[[_T], _R], work: Sequence[_T], turn: Iterable[int]) -> None:
        self._function, self._work, self._left = function, work, deque(turn)
        self._lock = threading.Lock()
        self._results: dict[int, _R] = {}
        self._failed: dict[int, BaseException] = {}
        self._helpers: list[threading.Thread] = []

    def done(self) -> list[_R]:
        """Do all parts, with whoever helps; return what comes of them, or raise the first error."""
        first = not _AT_WORK.get()
        _CREW.change(first)
        try:
            self._take()
            _CREW.change(-1)  # who waits leaves a processor to others
            try:
                for helper in self._helpers:
                    helper.join()
            finally:
                _CREW.change(+1)
        except BaseException:  # Ctrl-C between two parts
            self._left.clear()
            raise
        finally:
            _CREW.change(-first)
        if self._failed:
            raise self._failed[min(self._failed)]
        return [self._results[i] for i in range(len(self._work))]

    def _take(self) -> None:
        """Do one part after the other until none is left."""
        while (i := self._next()) is not None:
            self._call()
            try:
                self._results[i] = self._apart(self._work[i])
            except BaseException as error:
                self._failed[i] = error
                if not isinstance(error, Exception):
                    self._left.clear()
            with self._lock:
                tell((len(self._results) + len(self._failed)) / len(self._work))

    def _next(self) -> int | None:
        """Return the number of a part to do: once one has failed, only those before it matter."""
        with self._lock:
            while self._left:
                i = self._left.popleft()
                if all(i < failed for failed in self._failed):
                    return i
        return None

    def _call(self) -> None:
        """Have somebody help, if parts are left and a processor is free."""
        if self._left and not _ALONE.get() and _CREW.hire():
            helper = threading.Thread(target=copy_context().run, args=(self._help,))
            self._helpers.append(helper)
            helper.start()

    def _help(self) -> None:
        try:
            self._take()
        finally:
            _CREW.change(-1)

    def _apart(self, item: _T) -> _R:
        """Return what comes of a part; what it says of its own parts is nobody's business."""
        token = _AT_WORK.set(True)
        try:
            with following(None):
                return self._function(item)
        finally:
            _AT_WORK.reset(token)
