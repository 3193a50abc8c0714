"""Threads share work that falls into parts.

Most of the time goes into operations on long arrays, during which Python lets other threads run.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from fit.threads.progress import following, tell

_R = TypeVar("_R")
_T = TypeVar("_T")

_ALONE: ContextVar[bool] = ContextVar("_ALONE", default=False)


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def each(
    function: Callable[[_T], _R], items: Iterable[_T], size: Callable[[_T], float] | None = None
) -> list[_R]:
    """Return what a function makes of every item, in their order; threads share the work.

    What it raises for the first of them that fails is raised here. Parts of parts are done one by one.
    Whoever follows the work (`fit.threads.progress`) is told of every item. With `size`, threads begin with
    the largest, lest one is still at it when the others have nothing left.
    """
    work = list(items)
    threads = 1 if _ALONE.get() else min(processors(), len(work))
    if threads < 2:
        return list(_told((_apart(function, item) for item in work), len(work)))
    turn = sorted(range(len(work)), key=lambda i: -size(work[i])) if size else range(len(work))
    with ThreadPoolExecutor(threads, initializer=_ALONE.set, initargs=(True,)) as pool:
        begun = {i: pool.submit(function, work[i]) for i in turn}
        try:
            for done in _told(as_completed(begun.values()), len(work)):
                if done.exception():
                    break  # it remains to see whether one before it fails, too
            return [begun[i].result() for i in range(len(work))]
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _apart(function: Callable[[_T], _R], item: _T) -> _R:
    """Return what a function makes of an item; what it says of its own parts is nobody's business."""
    with following(None):
        return function(item)


def _told(results: Iterable[_R], n: int) -> Iterator[_R]:
    for done, result in enumerate(results, start=1):
        tell(done / n)
        yield result


@contextmanager
def alone() -> Iterator[None]:
    """Do everything in this thread, where other processes have the other processors."""
    token = _ALONE.set(True)
    try:
        yield
    finally:
        _ALONE.reset(token)
