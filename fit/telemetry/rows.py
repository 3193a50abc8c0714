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
from fit.telemetry.datasets import Stored, in_parts, read_channel
from fit.telemetry.pieces import Row

_WHOLE = 2**19  # samples; a channel of no more is read at once


class OnDemand(Mapping[str, NDArray[np.float64]]):
    """A part of the channels of a file, each read anew whenever it is asked for."""

    def __init__(self, path: Path, names: Sequence[str], part: slice, fs: float) -> None:
        self._path, self._names, self._part, self._fs = path, dict.fromkeys(names), part, fs

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self._names:
            raise KeyError(name)
        with opened(self._path) as file:
            return read_channel(file, self._path, name, self._part, self._fs)

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
        return OnDemand(self._path, list(self), slice(begin + first, min(begin + last, end)), self._fs)

    def row(self, name: str) -> Row:
        """Return a channel; a long one is read when parts of it are asked for."""
        with opened(self._path) as file:
            there = range(*self._part.indices(file[name].size))
            if len(there) <= _WHOLE or not in_parts(file[name]):
                return read_channel(file, self._path, name, self._part, self._fs)
            kept = h5py.File(self._path, "r")  # while parts are asked for: to open it takes as long as one
        return Stored(partial(_read, kept, self._path, name, self._fs), there)


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
