"""Writer of telemetry of schema ``lpf-telemetry/1``, block by block, in bounded memory."""

import os
import re
from collections.abc import Collection, Iterator, Mapping
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

    Same content, same bytes: nothing in the file depends on when or where it was written.

    Parameters
    ----------
    path : Path
        The file; its folder must exist.
    size : int
        Number of samples.
    channels : mapping of str to (str, str)
        Unit and description of every channel, in the order they stand in the file.
    attributes : mapping
        Of the root.
    truth : mapping, optional
        Attributes of a group ``/truth``.
    truths : mapping of str to (ndarray, str), optional
        Datasets in that group, each with its unit.
    complete : collection of str
        Channels that state, by an attribute missing_value of NaN, that no number marks missing samples.
    finite : bool
        Refuse values that are not.
    is_final : bool
        Whether the file is on disk before it has its name. To wait for the disk is no use where the file gets
        another name later.

    Raises
    ------
    FitError
        If the file cannot be written, or other samples come than were announced.
    """

    def __init__(
        self,
        path: Path,
        size: int,
        channels: Mapping[str, tuple[str, str]],
        attributes: Mapping[str, object],
        *,
        truth: Mapping[str, float] | None = None,
        truths: Mapping[str, tuple[Array, str]] | None = None,
        complete: Collection[str] = (),
        finite: bool = False,
        is_final: bool = True,
    ) -> None:
        self._path, self._is_final = path, is_final
        self._partial = atomic.temporary(path)
        self._size, self._done, self._finite = size, 0, finite
        self._channels: dict[str, h5py.Dataset] = {}
        with ExitStack() as undo, self._write_errors():
            undo.callback(self._discard)
            self._partial.open("wb").close()  # the operating system's words for a path that cannot be
            self._file = _create(self._partial)
            _annotate(self._file, attributes)
            # Held until the end: h5py swallows what goes wrong when a channel is closed.
            described = {"time": ("s", f"time since {attributes['t0']}"), **channels}
            for name, (unit, long_name) in described.items():
                self._channels[name] = channel = self._file.create_dataset(name, (size,), dtype="f8")
                _annotate(channel, {"units": unit, "long_name": long_name})
                if name in complete:
                    channel.attrs["missing_value"] = np.nan
                if name == "time":
                    channel.make_scale("time")
                else:
                    channel.dims[0].attach_scale(self._channels["time"])
            if truth is not None:
                group = self._file.create_group("truth")
                _annotate(group, truth)
                for name, (values, unit) in sorted((truths or {}).items()):
                    group.create_dataset(name, data=values).attrs["units"] = unit
            undo.pop_all()

    def append(
        self, time: Array, channels: Mapping[str, Array], missing: NDArray[np.bool_] | None = None
    ) -> None:
        """Write the next samples of all channels, NaN for those that are ``missing``."""
        if channels.keys() != self._channels.keys() - {"time"} or self._done + time.size > self._size:
            announced = f"{self._size} samples of {', '.join(self._channels)}"
            raise FitError(f"{self._path}: the samples differ from those announced, expected {announced}")
        for name, values in channels.items():
            if values.shape != time.shape:
                raise FitError(f"channel {name} has shape {values.shape}, expected {time.shape}")
            if self._finite and not (finite := np.isfinite(values)).all():
                i = int(finite.argmin())
                raise FitError(f"{name} is {values[i]} at t = {time[i]:g} s, nothing is recorded")
        part = slice(self._done, self._done + time.size)
        with self._write_errors():
            for name, dataset in self._channels.items():  # room in the file is given in this order
                values = time if name == "time" else channels[name]
                if missing is not None and name != "time":
                    values = np.where(missing, np.nan, values)
                dataset[part] = values
        self._done = part.stop

    def annotate(self, name: str, value: object) -> None:
        """Add an attribute of the root."""
        with self._write_errors():
            self._file.attrs[name] = value

    def __enter__(self) -> "Writer":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            with self._write_errors():
                if kind is None:
                    self._file.flush()
                self._file.close()
                if kind is None:
                    if self._done != self._size:
                        raise FitError(f"{self._done} samples received, expected {self._size}")
                    if self._is_final:
                        atomic.settle(self._partial, self._path)
                    else:
                        self._partial.replace(self._path)
        finally:
            self._discard()

    def _discard(self) -> None:
        self._channels.clear()
        with suppress(Exception):  # after a failure it may still be open
            self._file.close()
        with suppress(OSError):
            self._partial.unlink(missing_ok=True)

    @contextmanager
    def _write_errors(self) -> Iterator[None]:
        """Turn what the file system or HDF5 raises into one sentence."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise FitError(f"{self._path}: cannot be written ({_reason(error)})") from error


def _create(path: Path) -> h5py.File:
    """Create a file to which HDF5 writes at once: what it cannot write on closing ends the process."""
    with h5py.File(path, "w") as file:
        access = file.id.get_access_plist()
    access.set_sieve_buf_size(0)
    return h5py.File(h5py.h5f.open(os.fsencode(path), h5py.h5f.ACC_RDWR, fapl=access))


def _annotate(place: h5py.HLObject, attributes: Mapping[str, object]) -> None:
    for name in sorted(attributes):  # the order is part of the bytes
        place.attrs[name] = attributes[name]


def _reason(error: OSError | RuntimeError) -> str:
    """Return what the operating system says, which HDF5 hides in a sentence of its own."""
    match = re.search("error message = '([^']*)'", str(error))
    return match[1] if match else getattr(error, "strerror", None) or " ".join(str(error).split())
