"""How worker processes start: forked from a server that has imported their libraries, or spawned."""

from __future__ import annotations

import multiprocessing
import signal
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Windows lacks one of them
    from multiprocessing.context import ForkServerContext, SpawnContext

#: What workers that simulate import. No module of this package: the server may find another version of it.
LIBRARIES = (
    "numpy",
    "scipy.fft",
    "scipy.signal",
    "h5py",
    "fmpy",
    "fmpy.fmi2",
    "fmpy.fmi3",
    "fmpy.validation",
    "lxml.etree",
    "pebble",
    "xml.etree.ElementTree",
    "pydantic.main",
    "pydantic.types",
)

#: What workers that fit import besides.
FITTING = ("scipy.linalg",)


def preload(*modules: str) -> bool:
    """Start the server of the standard library on Linux; it imports `LIBRARIES` and `modules`.

    The server, and so every worker from its first instruction on, ignores Ctrl-C: to end the workers is up
    to this process.

    Returns
    -------
    bool
        Whether the server runs. Without a socket, such as in a folder for temporary files with a very long
        path, it cannot.
    """
    if sys.platform != "linux":  # elsewhere libraries do not outlive a fork
        return False
    from multiprocessing import forkserver

    multiprocessing.set_forkserver_preload([*LIBRARIES, *modules])
    is_main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if is_main else None
    try:
        forkserver.ensure_running()
    except OSError:
        return False
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
    return True


def context() -> ForkServerContext | SpawnContext:
    """Return the start method of workers; a fork of this process would share the state of its libraries."""
    if preload():
        return multiprocessing.get_context("forkserver")
    return multiprocessing.get_context("spawn")
