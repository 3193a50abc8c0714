"""Writer of telemetry of schema ``lpf-telemetry/1``, block by block, in bounded memory."""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.files import atomic

Array = NDArray[np.float64]


class Writer:
    """A file that appears whole or not at all; to be used in a ``with`` statement.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    size : int
        Number of samples.
    channels : mapping of str to (str, str)
        Unit and description of every channel.
    attributes : mapping
        Of the root.

    Raises
    ------
    FitError
        If the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        size: int,
        channels: Mapping[str, tuple[str, str]],
        attributes: Mapping[str, object],
    ) -> None:
        self._path = path
        self._partial = atomic.temporary(path)
        self._done = 0
        self._channels: dict[str, h5py.Dataset] = {}
        with ExitStack() as undo, self._told():
            undo.callback(self._discard)
            self._file = _create(self._partial)
            for name in sorted(attributes):
                self._file.attrs[name] = attributes[name]
            # Held until the end: h5py swallows what goes wrong when a channel is closed.
            self._channels["time"] = time = self._file.create_dataset("time", (size,), dtype="f8")
            time.attrs.update(units="s", long_name=f"time since {attributes['t0']}")
            time.make_scale("time")
            for name, (unit, long_name) in channels.items():
                self._channels[name] = channel = self._file.create_dataset(name, (size,), dtype="f8")
                channel.attrs.update(units=unit, long_name=long_name)
                channel.dims[0].attach_scale(time)
            undo.pop_all()

    def append(self, time: Array, channels: Mapping[str, Array]) -> None:
        """Write the next samples."""
        part = slice(self._done, self._done + time.size)
        with self._told():
            self._channels["time"][part] = time
            for name, values in channels.items():
                self._channels[name][part] = values
        self._done = part.stop

    def __enter__(self) -> "Writer":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            with self._told():
                if kind is None:
                    self._file.flush()
                self._file.close()
                if kind is None:
                    atomic.settle(self._partial, self._path)
        finally:
            self._discard()

    def _discard(self) -> None:
        self._channels.clear()
        with suppress(Exception):  # after a failure it may still be open
            self._file.close()
        with suppress(OSError):
            self._partial.unlink(missing_ok=True)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what the file system or HDF5 raises into one sentence."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise FitError(f"{self._path}: cannot be written ({_reason(error)})") from error


def _create(path: Path) -> h5py.File:
    """Create a file as h5py does, but let HDF5 write samples at once, not when a channel is closed."""
    with h5py.File(path, "w") as file:
        access = file.id.get_access_plist()
    access.set_sieve_buf_size(0)
    return h5py.File(h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDWR, fapl=access))


def _reason(error: OSError | RuntimeError) -> str:
    """Return what the operating system says, which HDF5 hides in a sentence of its own."""
    said = re.search("error message = '([^']*)'", str(error))
    return said[1] if said else getattr(error, "strerror", None) or " ".join(str(error).split())
