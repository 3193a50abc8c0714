"""Work shared among threads, linear algebra in one thread, and the progress of a piece of work."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")

_SERIAL: ContextVar[bool] = ContextVar("_SERIAL", default=False)


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def parallel_map(
    function: Callable[[_T], _R], items: Iterable[_T], size: Callable[[_T], float] | None = None
) -> list[_R]:
    """Return the results of a function for all items, in their order; threads share the items.

    Most of the time goes into operations on long arrays, during which Python lets other threads run. A call
    within an item, or within `serial`, is a plain loop. The progress is updated after each item.

    Parameters
    ----------
    function : callable
        Called with each item.
    items : iterable
        What it is called with.
    size : callable, optional
        About how long an item takes, in any unit: the longest are begun first.

    Raises
    ------
    Exception
        The first one that `function` raises, in the order in which items are begun. Items that have not been
        begun by then are left out.
    """
    work = list(items)
    if _SERIAL.get() or processors() < 2 or len(work) < 2:
        return [*_with_progress(_loop(function, work), len(work))]
    order = sorted(range(len(work)), key=lambda i: -size(work[i])) if size else range(len(work))
    # each thread has a context of its own, in which it is serial
    with ThreadPoolExecutor(processors(), initializer=_SERIAL.set, initargs=(True,)) as pool:
        outcomes = _with_progress(pool.map(function, [work[i] for i in order]), len(work))
        results = dict(zip(order, outcomes, strict=True))
    return [results[i] for i in range(len(work))]


def _loop(function: Callable[[_T], _R], work: Iterable[_T]) -> Iterator[_R]:
    for item in work:
        with follow_progress(None):  # the progress of an item is not that of all
            result = function(item)
        yield result


def _with_progress(results: Iterable[_R], number: int) -> Iterator[_R]:
    for n, result in enumerate(results, 1):
        yield result
        update_progress(n / number)


@contextmanager
def serial() -> Iterator[None]:
    """Do everything in this thread, where other processes have the other processors."""
    token = _SERIAL.set(True)
    try:
        yield
    finally:
        _SERIAL.reset(token)


def one_blas_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a function that calls another while the linear algebra has one thread.

    Matrices here are tall and narrow: its threads wait for each other more than they compute. Where other
    work shares the processors they wait for that too, for four times as long as the fit takes.
    """

    @wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        import scipy.linalg  # noqa: F401  only a library that is loaded can be limited
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


class _Progress:
    """The progress of a piece of work, of which a stage is being done; it never falls."""

    def __init__(self, callback: Callable[[float], None]) -> None:
        self._callback = callback
        self._begin, self._end, self._most, self._stages = 0.0, 1.0, 0.0, 0

    def stage(self, end: float) -> None:
        self._begin, self._end = self._end if self._stages else 0.0, end
        self._stages += 1
        self.update(0.0)

    def update(self, done: float) -> None:
        now = self._begin + done * (self._end - self._begin)
        if now > self._most:
            self._most = now
            self._callback(now)


_PROGRESS: ContextVar[_Progress | None] = ContextVar("_PROGRESS", default=None)


@contextmanager
def follow_progress(callback: Callable[[float], None] | None) -> Iterator[None]:
    """Call a function with the fraction of the work that is done, from 0 to 1; None is not called."""
    token = _PROGRESS.set(_Progress(callback) if callback else None)
    try:
        yield
    finally:
        _PROGRESS.reset(token)


@contextmanager
def progress_range(begin: float, end: float) -> Iterator[None]:
    """Do a piece of the work that is followed, from one fraction of it to another."""
    whole = _PROGRESS.get()
    with follow_progress((lambda done: whole.update(begin + done * (end - begin))) if whole else None):
        yield


def progress_stage(end: float) -> None:
    """Begin the stage of the work that ends at about this fraction of it, where the last one ended."""
    if progress := _PROGRESS.get():
        progress.stage(end)


def update_progress(done: float) -> None:
    """Set the fraction of the present stage that is done, from 0 to 1."""
    if progress := _PROGRESS.get():
        progress.update(done)
