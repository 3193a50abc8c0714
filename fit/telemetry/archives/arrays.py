"""Arrays of NumPy and HDF5 as columns of a table."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fit.errors import InputError
from fit.telemetry.archives.table import Column

MOST_COLUMNS = 1000  # of a matrix
_NUMBERS, _TEXTS = "iufb", "SUT"
_KINDS = {"c": "complex numbers", "m": "durations", "V": "records", "O": "objects"}


@dataclass(frozen=True)
class LazyArray:
    """An array that is loaded, once and whole, when one of its columns is read.

    Attributes
    ----------
    shape, dtype : tuple of int, numpy.dtype
        Of the array.
    load : callable
        Returns it.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    load: Callable[[], Any]

    @classmethod
    def wrap(cls, array: Any) -> "LazyArray":
        """Wrap an array of NumPy, or a dataset of HDF5 with the axes that it has in MATLAB."""
        if isinstance(array, h5py.Dataset):
            if "MATLAB_class" in array.attrs:  # stored column by column
                return cls(array.shape[::-1], array.dtype, cache(lambda: array[()].T))
            return cls(array.shape, array.dtype, cache(lambda: array[()]))
        return cls(array.shape, array.dtype, lambda: array)

    def field(self, name: str) -> "LazyArray":
        """Return a field of records."""
        kind = self.dtype[name]
        return LazyArray((*self.shape, *kind.shape), kind.base, lambda: self.load()[name])

    def row(self, axis: int, index: Mapping[int, int], unit: str | None = None) -> Column:
        """Return the column along an axis, at places of other axes, or at 0."""
        places = tuple(slice(None) if i == axis else index.get(i, 0) for i in range(len(self.shape)))
        size = self.shape[axis]

        def read() -> Any:
            return self.load()[places]

        if self.dtype.kind == "M":
            return Column(size, None, "text", True, lambda: np.datetime_as_string(np.asarray(read())))
        is_text = self.dtype.kind not in _NUMBERS
        return Column(size, unit, "text" if is_text else "", is_text, read)


def columns_of(name: str, array: LazyArray, unit: str | None = None) -> dict[str, Column]:
    """Return the columns that an array makes.

    Parameters
    ----------
    name : str
        Its name: that of a column if it is a row; column k of a matrix is ``name[k]``, where time goes along
        the longer axis; a field of records is ``name.field``.
    array : LazyArray
        Of any shape and type.
    unit : str or None
        As the file states it.
    """
    if array.dtype.names == ("real", "imag"):  # of MATLAB 7.3
        columns = {name: Column(None, unit, _KINDS["c"])}
    elif array.dtype.names:
        columns = {}
        for field in array.dtype.names:
            columns |= columns_of(f"{name}.{field}" if name else field, array.field(field), unit)
    else:
        columns = _plain_columns(name, array, unit)
    return {key: replace(column, source=name) for key, column in columns.items()}


def _plain_columns(name: str, array: LazyArray, unit: str | None) -> dict[str, Column]:
    """Return the columns of an array that has no fields."""
    kind, size = array.dtype.kind, array.shape[0] if array.shape else 0
    is_text = kind in _TEXTS or (kind == "O" and h5py.check_string_dtype(array.dtype) is not None)
    if not is_text and kind not in (*_NUMBERS, "M"):
        return {name: Column(None, unit, _KINDS.get(kind, str(array.dtype)))}
    if kind == "S" and array.dtype.itemsize == 1 and len(array.shape) == 2:  # letters, as in netCDF
        return {name: Column(size, unit, "text", True, lambda: [b"".join(row) for row in array.load()])}
    axes = [axis for axis, n in enumerate(array.shape) if n != 1]
    if 0 in array.shape:
        return {name: Column(None, unit, "empty")}
    if not array.shape or len(axes) > 2:
        scalar = "text" if is_text else "a single value"
        return {name: Column(None, unit, f"an array of shape {array.shape}" if array.shape else scalar)}
    if len(axes) < 2:
        return {name: array.row(int(np.argmax(array.shape)), {}, unit)}
    time, across = axes if array.shape[axes[0]] >= array.shape[axes[1]] else axes[::-1]
    if array.shape[across] > MOST_COLUMNS:
        return {name: Column(None, unit, f"a matrix of shape {array.shape}")}
    names = [f"{name}[{k + 1}]" if name else f"{k + 1}" for k in range(array.shape[across])]
    return {names[k]: array.row(time, {across: k}, unit) for k in range(len(names))}


def select_table(path: Path, columns: Mapping[str, Column], table: str | int | None) -> Mapping[str, Column]:
    """Return what lies in a struct, a group or an array, without its name.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if table is None:
        return columns
    name = str(table).strip("/").replace("/", ".")
    members = {
        k.removeprefix(f"{name}."): column for k, column in columns.items() if k.startswith(f"{name}.")
    }
    if not members:
        members = {k[len(name) + 1 : -1]: column for k, column in columns.items() if k.startswith(f"{name}[")}
    if not members and name in columns and columns[name].size is None:
        raise InputError(f"{path}: table {table!r}: {columns[name].reason}, expected a struct or group")
    if not members:
        names = dict.fromkeys(k.rpartition("[" if k.endswith("]") else ".")[0] for k in columns)
        available = ", ".join(name for name in names if name and not name.endswith(" ")) or "none"
        raise InputError(f"{path}: no table {table!r}, expected a struct or group; there are: {available}")
    return members
