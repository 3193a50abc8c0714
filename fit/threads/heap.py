"""One heap for all threads: what one gives back is there for the others, and for the rest of the machine."""

import ctypes
import gc
import sys
from collections.abc import Callable

_ARENA_MAX = -8  # of mallopt, in malloc.h of glibc


def one_heap() -> None:
    """Let all threads of this process take their memory from one heap, where the C library can be told to.

    By default each has its own, and keeps the room of what was large once.
    """
    if function := _function("mallopt"):
        function(_ARENA_MAX, 1)


def give_back() -> None:
    """Give back to the system what is free in between, where the C library can be told to.

    Objects that only hold each other are freed first: arrays of a fit are among them.
    """
    gc.collect()
    if function := _function("malloc_trim"):
        function(0)


def _function(name: str) -> Callable[..., int] | None:
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
