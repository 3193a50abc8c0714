"""Room for the long arrays of long runs: in a file, of which memory holds what is worked on.

What a fit keeps of a run grows with its length, and most of it waits. Beyond `LONG` samples it lies in a
file without a name, where the system is Linux and its file system reserves room; else in memory, as all the
rest.
"""

import ctypes
import math
import os
import sys
import tempfile
import threading
import weakref
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

LONG = 2**18  # samples of a run, beyond which what is kept of it lies in a file
_READ_WRITE, _SHARED, _FAILED, _DONT_NEED = 3, 1, ctypes.c_void_p(-1).value, 4  # of mman.h in Linux


def room(shape: tuple[int, ...], samples: int, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return an array of any values, column after column, for what is kept of a run of so many samples."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    pages = _pages(size) if samples > LONG and size else None
    if pages is None:
        return np.empty(shape, dtype, order="F")
    return np.asarray(pages).view(dtype).reshape(shape, order="F")


def laid(x: NDArray[Any], samples: int) -> NDArray[Any]:
    """Return an array as `room` for it has it, itself if that is in memory as well."""
    return copied(x, samples) if samples > LONG else x


def copied(x: NDArray[Any], samples: int) -> NDArray[Any]:
    """Return a copy of an array, column after column, as `room` for it has it."""
    found = room(x.shape, samples, x.dtype)
    found[...] = x
    return found


def put_down() -> None:
    """Let memory go of what lies in files; what is asked for again comes back from there."""
    with _LOCK:
        alive = list(_ALIVE)
    for pages in alive:
        pages.put_down()


class _Pages:
    """A file without a name that looks like memory, as NumPy takes it; gone when nobody has it any more."""

    def __init__(self, size: int, file: int) -> None:
        address = _LIBRARY.mmap(None, size, _READ_WRITE, _SHARED, file, 0)
        if address == _FAILED:
            raise OSError("no room in the address space")
        self._at = address, size
        memory = {"data": (address, False), "shape": (size,), "typestr": "|u1", "version": 3}
        self.__array_interface__ = memory
        weakref.finalize(self, _LIBRARY.munmap, address, size).atexit = False

    def put_down(self) -> None:
        """Let memory go of it, see `put_down`."""
        _LIBRARY.madvise(*self._at, _DONT_NEED)


_ALIVE: weakref.WeakSet[_Pages] = weakref.WeakSet()
_LOCK = threading.Lock()


def _pages(size: int) -> _Pages | None:
    if _LIBRARY is None:
        return None
    try:
        # not in /tmp, which is often memory itself
        with tempfile.TemporaryFile(dir=os.environ.get("TMPDIR") or "/var/tmp") as file:
            # else a full disk would end the process later; that of POSIX would write a byte to every block
            # where the file system cannot, which takes its time, and reserves nothing if that is compressed
            if _LIBRARY.fallocate(file.fileno(), 0, 0, size):
                return None
            pages = _Pages(size, file.fileno())
    except OSError:
        return None
    with _LOCK:
        _ALIVE.add(pages)
    return pages


def _library() -> Any:
    if sys.platform != "linux":
        return None
    library = ctypes.CDLL(None)
    pointer, size, number, offset = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_long
    library.mmap.restype = pointer
    library.mmap.argtypes = [pointer, size, number, number, number, offset]
    library.fallocate.argtypes = [number, number, offset, offset]
    library.munmap.argtypes, library.madvise.argtypes = [pointer, size], [pointer, size, number]
    return library


_LIBRARY = _library()
