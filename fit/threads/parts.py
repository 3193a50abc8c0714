"""Threads share work that falls into parts.

Most of the time goes into operations on long arrays, during which Python lets other threads run.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

_R = TypeVar("_R")
_T = TypeVar("_T")

_ALONE: ContextVar[bool] = ContextVar("_ALONE", default=False)


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def each(function: Callable[[_T], _R], items: Iterable[_T]) -> list[_R]:
    """Return what a function makes of every item, in their order; threads share the work.

    What it raises for the first of them that fails is raised here. Parts of parts are done one by one.
    """
    work = list(items)
    threads = 1 if _ALONE.get() else min(processors(), len(work))
    if threads < 2:
        return [function(item) for item in work]
    with ThreadPoolExecutor(threads, initializer=_ALONE.set, initargs=(True,)) as pool:
        return list(pool.map(function, work))


@contextmanager
def alone() -> Iterator[None]:
    """Do everything in this thread, where other processes have the other processors."""
    token = _ALONE.set(True)
    try:
        yield
    finally:
        _ALONE.reset(token)
