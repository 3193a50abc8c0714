"""Channels of a file, read when they are asked for, and part by part: of weeks, one fills the memory."""

import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.telemetry.contract import SCHEMA
from fit.telemetry.datasets import Plain, Stored, in_parts, read_channel
from fit.telemetry.pieces import Row

_NO_ARCHIVES = ("", ".h5", ".json", ".toml")  # suffixes
_WHOLE = 2**19  # samples; a channel of no more is read at once
State = tuple[int, int, int]  # of a file: inode, bytes, time it was written


class OnDemand(Mapping[str, NDArray[np.float64]]):
    """A part of the channels of a file, each read anew whenever it is asked for.

    That the file is still the one of the beginning is made sure of: parts of two would look like one.

    Parameters
    ----------
    path : Path
        The file.
    places : mapping of str to Plain or None
        Where its channels lie, see `datasets.lying`.
    part : slice
        Of their samples.
    fs : float
        Sample rate [Hz].
    of : tuple, optional
        The state of the file that is meant; by default what it is now.
    """

    def __init__(
        self,
        path: Path,
        places: Mapping[str, Plain | None],
        part: slice,
        fs: float,
        state: State | None = None,
    ) -> None:
        self._path, self._places, self._part, self._fs = path, places, part, fs
        self._state = state or _state(path)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self._read(name, self._part)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def part(self, index: slice) -> "OnDemand":
        """Return some of the samples of all of them."""
        start, stop, _ = index.indices(sys.maxsize)
        begin, end, _ = self._part.indices(sys.maxsize)
        return self.stretch(slice(begin + start, min(begin + stop, end)))

    def stretch(self, of_file: slice) -> "OnDemand":
        """Return other samples of the file."""
        return OnDemand(self._path, self._places, of_file, self._fs, self._state)

    def row(self, name: str) -> Row:
        """Return a channel; a long one is read when parts of it are asked for."""
        known = self._places[name]
        if known is not None:
            samples = range(*self._part.indices(known.size))
            whole = len(samples) <= _WHOLE
            return self._read(name, self._part) if whole else Stored(partial(self._read, name), samples)
        with opened(self._path) as file:
            self._check(_state(self._path))
            samples = range(*self._part.indices(file[name].size))
            if len(samples) <= _WHOLE or not in_parts(file[name]):
                return read_channel(file, self._path, name, self._part, self._fs)
            file = h5py.File(self._path, "r")  # while parts are asked for: to open it takes as long as one
        return Stored(partial(_read, file, self._path, name, self._fs), samples)

    def _read(self, name: str, part: slice) -> NDArray[np.float64]:
        known = self._places[name]
        if known is None:
            with opened(self._path) as file:
                self._check(_state(self._path))
                return read_channel(file, self._path, name, part, self._fs)
        _check_there(self._path)
        with _read_errors(self._path), self._path.open("rb") as plain:
            self._check(_state_of(plain))
            return known.read(plain, self._path, name, part, self._fs)

    def _check(self, now: State) -> None:
        if now != self._state:
            raise InputError(f"{self._path}: was written again meanwhile, expected the file as it was first")


def _state(path: Path) -> State:
    with path.open("rb") as file:
        return _state_of(file)


def _state_of(file: BinaryIO) -> State:
    """Return what tells that a file is another one, or was written again."""
    status = os.fstat(file.fileno())  # always so: on Windows, asked by its path, a file may tell another time
    return status.st_ino, status.st_size, status.st_mtime_ns


def _read(file: h5py.File, path: Path, name: str, fs: float, part: slice) -> NDArray[np.float64]:
    with _read_errors(path):
        return read_channel(file, path, name, part, fs)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """Open a telemetry file.

    Raises
    ------
    InputError
        If it is none, or what is done with it meets a damage.
    """
    _check_there(path)
    with _read_errors(path), h5py.File(path, "r") as file:
        yield file


def _check_there(path: Path) -> None:
    if not path.is_file():
        known = "is a folder" if path.is_dir() else "no such file"
        raise InputError(f"{path}: {known}, expected telemetry of schema {SCHEMA!r}")


@contextmanager
def _read_errors(path: Path) -> Iterator[None]:
    """Say which file it is that a damage is met in."""
    try:
        yield
    except PermissionError:
        raise InputError(f"{path}: cannot be read (permission denied), expected telemetry") from None
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError, MemoryError) as error:
        is_hdf5 = h5py.is_hdf5(path)
        fault = "truncated or damaged" if is_hdf5 else "not HDF5"
        advice = "" if is_hdf5 or path.suffix in _NO_ARCHIVES else _map_advice(path)
        raise InputError(f"{path}: {fault}, expected an HDF5 file of schema {SCHEMA!r}{advice}") from error


def check_schema(path: Path, schema: object) -> None:
    """Refuse a file of another schema, or of none, which may be an archive."""
    if schema is None:
        raise InputError(f"{path}: attribute schema: missing, expected {SCHEMA!r}{_map_advice(path)}")
    if schema != SCHEMA:
        raise InputError(f"{path}: attribute schema: {shown(schema)}, expected {SCHEMA!r}")


def _map_advice(path: Path) -> str:
    """Return what to do with an archive that is no telemetry, as the end of a message."""
    return f"; for another archive write a map: lpfcosim new --map {shlex.quote(str(path))}"
