"""One heap for all threads: what one gives back is there for the others, and for the rest of the machine."""

import ctypes
import gc
import sys
from collections.abc import Callable
from functools import lru_cache
from typing import ParamSpec, TypeVar, cast

_P = ParamSpec("_P")
_R = TypeVar("_R")

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # of mallopt, in malloc.h of glibc
# Bytes beyond which an array takes its memory from the system, which clears every page of it. Two series of
# 65 h at 1 Hz side by side, as they are transformed, have 3.7 MB.
_LARGE = 4 * 2**20
_FREEING: list[Callable[[], None]] = []


def freed_by(function: Callable[[], None]) -> Callable[[], None]:
    """Have a function free what it knows of before memory is given back."""
    _FREEING.append(function)
    return function


def kept(most: int) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Keep as many results of a function, the last ones, until memory is given back."""

    def keeping(function: Callable[_P, _R]) -> Callable[_P, _R]:
        found = lru_cache(maxsize=most)(function)
        freed_by(found.cache_clear)
        return cast(Callable[_P, _R], found)

    return keeping


def one_heap() -> None:
    """Let all threads of this process take their memory from one heap, where the C library can be told to.

    By default each has its own, and keeps the room of what was large once. And by default an array takes its
    memory from the system and gives it back at once, which has to clear every page of the next one. From this
    heap it goes back when there is much of it, or by `give_back`.
    """
    if function := _function("mallopt"):
        function(_ARENA_MAX, 1)
        function(_MMAP_THRESHOLD, _LARGE)
        function(_TRIM_THRESHOLD, 2**26)


def give_back() -> None:
    """Give back to the system what is free in between, where the C library can be told to.

    What is `freed_by` others is freed first, and objects that only hold each other: arrays of a fit are among
    them.
    """
    for free in _FREEING:
        free()
    gc.collect()
    if function := _function("malloc_trim"):
        function(0)


def _function(name: str) -> Callable[..., int] | None:
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
