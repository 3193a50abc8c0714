"""Channels that are read from their file whenever they are asked for, and how a telemetry file is opened."""

import os
import shlex
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, MissingKeyError, shown
from fit.files import short_path
from fit.telemetry.contract import SCHEMA
from fit.telemetry.validation import read_channel


class LazyChannels(Mapping[str, NDArray[np.float64]]):
    """Some samples of the channels of a file: a campaign of weeks does not fit into memory.

    A file that is written again in the meantime is refused, since parts of two would look like one.

    Parameters
    ----------
    path : Path
        The file.
    names : collection of str
        The channels.
    samples : range
        Numbers of the samples, of which the file has all.
    fs : float
        Sample rate [Hz].
    """

    def __init__(self, path: Path, names: Collection[str], samples: range, fs: float) -> None:
        self._path, self._names, self._samples, self._fs = path.absolute(), names, samples, fs
        self._state = _state(path)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self._names:
            known = ", ".join(self._names)
            raise MissingKeyError(f"{short_path(self._path)}: no channel {shown(name)}, known: {known}")
        path = short_path(self._path)
        with open_file(path) as file:
            if _state(path) != self._state:
                raise InputError(f"{path}: was written again meanwhile, expected the file as it was first")
            samples = slice(self._samples.start, self._samples.stop)
            return read_channel(file, path, name, samples, self._fs)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def part(self, index: slice) -> "LazyChannels":
        """Return some of the samples of all channels."""
        channels = LazyChannels(self._path, self._names, self._samples[index], self._fs)
        channels._state = self._state
        return channels


def _state(path: Path) -> tuple[int, int, int]:
    """Return inode, size and time of writing of a file."""
    status = path.stat()
    return status.st_ino, status.st_size, status.st_mtime_ns


@contextmanager
def open_file(path: Path, schema: str = SCHEMA) -> Iterator[h5py.File]:
    """Open a telemetry file, or one of another schema.

    Raises
    ------
    InputError
        If it is none, or damaged where it is read.
    """
    content = "telemetry" if schema == SCHEMA else "a file"
    if not path.is_file():
        known = "is a folder" if path.is_dir() else "is not a file" if path.exists() else "no such file"
        raise InputError(f"{path}: {known}, expected {content} of schema {schema!r}")
    try:
        with h5py.File(path, "r") as file:
            yield file
    except InputError:
        raise
    except Exception as error:  # a damaged file makes h5py and NumPy raise almost anything
        is_readable = isinstance(error, PermissionError | MemoryError) or h5py.is_hdf5(path)
        fault = f"cannot be read ({' '.join(str(error).split())})" if is_readable else "not HDF5"
        advice = "" if is_readable or schema != SCHEMA else _map_advice(path)
        raise InputError(f"{path}: {fault}, expected an HDF5 file of schema {schema!r}{advice}") from error


def root_attributes(path: Path) -> dict[str, Any] | None:
    """Return the attributes of the root of an HDF5 file; None if it is missing, damaged or no HDF5.

    Raises
    ------
    InputError
        If it cannot be opened, so that nothing is known of it.
    """
    try:
        with h5py.File(path) as file:
            return dict(file.attrs)
    except FileNotFoundError:
        return None
    except Exception as error:  # whatever HDF5 and NumPy make of a file that is damaged
        if isinstance(error, OSError) and error.errno:  # of the operating system
            reason = os.strerror(error.errno)
            raise InputError(
                f"{path}: cannot be opened ({reason}), expected a file that can be read"
            ) from error
        return None


def check_schema(path: Path, schema: object) -> None:
    """Refuse a file of another schema, or of none, which may be an archive."""
    if not isinstance(schema, str) or schema != SCHEMA:
        stated, advice = ("missing", _map_advice(path)) if schema is None else (shown(schema), "")
        raise InputError(f"{path}: attribute schema: {stated}, expected {SCHEMA!r}{advice}")


def _map_advice(path: Path) -> str:
    """Return what to do with an archive that is no telemetry, as the end of a message."""
    return f"; an archive is described by a map: lpfcosim new --map {shlex.quote(path.stem)}.toml"
