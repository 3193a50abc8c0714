"""Where workers come from: each a fresh interpreter, or the child of one that has read in what all need.

To read in the libraries takes a worker longer than many a run. A server of the standard library does it once,
while the command reads its campaign; no FMU is ever loaded there, so that its children share nothing that a
task has touched.
"""

from __future__ import annotations

import multiprocessing as mp
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Windows lacks one of them
    from multiprocessing.context import ForkServerContext, SpawnContext

#: What workers need that simulate. Nothing of ours: the server may find another version of it.
LIBRARIES = (
    "numpy",
    "scipy.fft",
    "scipy.special",
    "h5py",
    "fmpy",
    "fmpy.fmi2",
    "fmpy.fmi3",
    "fmpy.validation",
    "lxml.etree",
    "xml.etree.ElementTree",
    "pydantic.main",
    "pydantic.types",
)

#: What those need besides that fit as well.
FITTING = ("scipy.linalg", "scipy.signal")

_prepared = False


def preload(*more: str) -> None:
    """Begin to read in `LIBRARIES` and `more`, in a process that ends with this one, if there can be one."""
    global _prepared
    if sys.platform == "linux" and not _prepared:  # elsewhere libraries do not outlive a fork
        from multiprocessing import forkserver

        mp.set_forkserver_preload([*LIBRARIES, *more])
        # OSError: a folder for its socket that is full, or whose path is too long for one
        with suppress(OSError), interrupts_held():
            forkserver.ensure_running()
            _prepared = True


def context() -> ForkServerContext | SpawnContext:
    """Return how workers are to be started; a fork of this process would share the state of its libraries."""
    return mp.get_context("forkserver") if _prepared else mp.get_context("spawn")


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while a process starts, which so never sees it: to end it is up to this process.

    Here it is told afterwards, as is SIGTERM: half a start would leave a process that nobody knows of.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    came: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # another thread may be the one that is told
        for number in (signal.SIGINT, signal.SIGTERM):
            handlers[number] = signal.signal(number, lambda number, _frame: came.append(number))
    resource_tracker.ensure_running()  # the standard library's; it lets interrupts through once it is started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        for caught in dict.fromkeys(came):  # one that is ignored, as in a background job, does nothing
            signal.raise_signal(caught)
