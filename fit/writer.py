"""Writer of telemetry of schema ``lpf-telemetry/1``, block by block, in bounded memory."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError

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
        self._partial = path.with_name(f".{path.name}.{os.getpid()}.part")
        self._done = 0
        with self._told():
            self._file = h5py.File(self._partial, "w")
            for name in sorted(attributes):
                self._file.attrs[name] = attributes[name]
            time = self._file.create_dataset("time", (size,), dtype="f8")
            time.attrs.update(units="s", long_name=f"time since {attributes['t0']}")
            time.make_scale("time")
            for name, (unit, long_name) in channels.items():
                channel = self._file.create_dataset(name, (size,), dtype="f8")
                channel.attrs.update(units=unit, long_name=long_name)
                channel.dims[0].attach_scale(time)

    def append(self, time: Array, channels: Mapping[str, Array]) -> None:
        """Write the next samples."""
        part = slice(self._done, self._done + time.size)
        with self._told():
            self._file["time"][part] = time
            for name, values in channels.items():
                self._file[name][part] = values
        self._done = part.stop

    def __enter__(self) -> "Writer":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            with self._told():
                self._file.close()
                if kind is None:
                    self._partial.replace(self._path)
        finally:
            with suppress(OSError):
                self._partial.unlink(missing_ok=True)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn what the file system or HDF5 raises into one sentence."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            why = getattr(error, "strerror", None) or str(error).splitlines()[0]
            raise FitError(f"{self._path}: cannot be written ({why})") from error
