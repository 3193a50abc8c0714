"""One heap for all threads: what one gives back is there for the others, and for the rest of the machine."""

import ctypes
import gc
import sys
from collections.abc import Callable
from functools import lru_cache
from typing import ParamSpec, TypeVar, cast

_P = ParamSpec("_P")
_R = TypeVar("_R")

_ARENA_MAX = -8  # of mallopt, in malloc.h of glibc
_CACHES: list[Callable[[], None]] = []


def kept(most: int) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Keep as many results of a function, the last ones, until memory is given back."""

    def keeping(function: Callable[_P, _R]) -> Callable[_P, _R]:
        found = lru_cache(maxsize=most)(function)
        _CACHES.append(found.cache_clear)
        return cast(Callable[_P, _R], found)

    return keeping


def one_heap() -> None:
    """Let all threads of this process take their memory from one heap, where the C library can be told to.

    By default each has its own, and keeps the room of what was large once.
    """
    if function := _function("mallopt"):
        function(_ARENA_MAX, 1)


def give_back() -> None:
    """Give back to the system what is free in between, where the C library can be told to.

    Results that were `kept` are freed first, and objects that only hold each other: arrays of a fit are among
    them.
    """
    for clear in _CACHES:
        clear()
    gc.collect()
    if function := _function("malloc_trim"):
        function(0)


def _function(name: str) -> Callable[..., int] | None:
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
