"""Channels of a file, read when they are asked for, and part by part: of weeks, one fills the memory."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.telemetry.contract import SCHEMA
from fit.telemetry.datasets import Plain, Stored, in_parts, lying, read_channel
from fit.telemetry.pieces import Row

_WHOLE = 2**19  # samples; a channel of no more is read at once
_State = tuple[int, int, int]  # of a file: inode, bytes, time it was written


class OnDemand(Mapping[str, NDArray[np.float64]]):
    """A part of the channels of a file, each read anew whenever it is asked for."""

    def __init__(self, path: Path, names: Sequence[str], part: slice, fs: float) -> None:
        self._path, self._names, self._part, self._fs = path, dict.fromkeys(names), part, fs
        self._lying: dict[str, tuple[_State, Plain | None]] = {}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self._names:
            raise KeyError(name)
        return self._read(name, self._part)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def part(self, at: slice) -> "OnDemand":
        """Return some of the samples of all of them."""
        first, last, _ = at.indices(sys.maxsize)
        begin, end, _ = self._part.indices(sys.maxsize)
        found = OnDemand(self._path, list(self), slice(begin + first, min(begin + last, end)), self._fs)
        found._lying = self._lying
        return found

    def row(self, name: str) -> Row:
        """Return a channel; a long one is read when parts of it are asked for."""
        known = self._known(name)
        if known is not None:
            there = range(*self._part.indices(known.size))
            whole = len(there) <= _WHOLE
            return self._read(name, self._part) if whole else Stored(partial(self._read, name), there)
        with opened(self._path) as file:
            there = range(*self._part.indices(file[name].size))
            if len(there) <= _WHOLE or not in_parts(file[name]):
                return read_channel(file, self._path, name, self._part, self._fs)
            kept = h5py.File(self._path, "r")  # while parts are asked for: to open it takes as long as one
        return Stored(partial(_read, kept, self._path, name, self._fs), there)

    def _read(self, name: str, part: slice) -> NDArray[np.float64]:
        known = self._known(name)
        if known is None:
            with opened(self._path) as file:
                return read_channel(file, self._path, name, part, self._fs)
        with _told(self._path):
            return known.read(self._path, name, part, self._fs)

    def _known(self, name: str) -> Plain | None:
        """Return where a channel lies in the file as it is now; HDF5 is asked once, for all of them."""
        try:
            state = _state(self._path)
        except OSError:  # is told by who opens it
            return None
        if self._lying.get(name, (None, None))[0] != state:
            with opened(self._path) as file:
                self._lying.update({n: (state, lying(file, n)) for n in self._names})
        return self._lying[name][1]


def _state(path: Path) -> _State:
    """Return what tells that a file is another one, or was written again."""
    found = path.stat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def _read(file: h5py.File, path: Path, name: str, fs: float, part: slice) -> NDArray[np.float64]:
    with _told(path):
        return read_channel(file, path, name, part, fs)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a telemetry file.

    Raises
    ------
    InputError
        If it is none, or what is done with it meets a damage.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected telemetry of schema {SCHEMA!r}")
    with _told(path), h5py.File(path, "r") as file:
        yield file


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Say which file it is that a damage is met in."""
    try:
        yield
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, MemoryError) as error:
        fault = "truncated or damaged" if h5py.is_hdf5(path) else "not HDF5"
        raise InputError(f"{path}: {fault}, expected an HDF5 file of schema {SCHEMA!r}") from error
