"""Arrays of NumPy and HDF5 as the columns of a table."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from fit.errors import InputError
from fit.files import key
from fit.telemetry.archives.table import Array, Column, Table, parts, split_unit

MOST_COLUMNS = 1000  # of a matrix
_OF_MATRIX = re.compile(r"(.+)\[\d+\]")
_NUMBERS, _TEXTS = "iufb", "SUT"
_KINDS = {"c": "complex numbers", "m": "durations", "V": "records", "O": "objects"}


@dataclass(frozen=True)
class Series:
    """A column, and how to read a part of it; `read` is None where there are neither numbers nor texts.

    Attributes
    ----------
    column : Column
        What it is.
    read : callable or None
        Returns the rows of a slice: an array of numbers with NaN for missing samples, or one of texts.
    source : str
        What it is a column of: the array, or the table in the file. These have an order, a file has none.
    dtype : numpy.dtype or None
        Of the stored values, where an array of the file has them.
    field : str
        Name of the field of records that it is, empty for others.
    """

    column: Column
    read: Callable[[slice], Any] | None = None
    source: str = ""
    dtype: np.dtype[Any] | None = None
    field: str = ""

    def scaled(self, factor: float, offset: float = 0.0) -> "Series":
        """Return these numbers times a factor, plus an offset."""
        read = self.read
        assert read is not None
        return replace(self, read=lambda part: factor * np.asarray(read(part), np.float64) + offset)

    def missing_at(self, marks: Any) -> "Series":
        """Return these numbers with NaN in the place of some, given as an array of their type."""
        read = self.read
        assert read is not None

        def masked(part: slice) -> Any:
            values = np.asarray(read(part))
            return np.where(np.isin(values, marks), np.nan, values)

        return replace(self, read=masked)


class Arrays(Table):
    """Series by name; those of one source have an order."""

    def __init__(self, path: Path, kind: str, series: Mapping[str, Series]) -> None:
        self.path, self.kind, self._series = path, kind, series
        self.columns = {
            name: values.column if values.column.unit else replace(values.column, unit=split_unit(name)[1])
            for name, values in series.items()
        }
        self.order = _order(series)

    def _blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        """Yield columns of numbers."""
        for part in parts(self.columns[names[0]].size or 0):
            yield [np.asarray(self._part(name, part, text=False), np.float64) for name in names]

    def _texts(self, name: str) -> Iterator[list[str]]:
        """Yield a column of texts."""
        for part in parts(self.columns[name].size or 0):
            yield [_text(value) for value in self._part(name, part, text=True)]

    def _part(self, name: str, part: slice, *, text: bool) -> Any:
        read, column = self._series[name].read, self.columns[name]
        if read is None or column.text is not text:
            expected = "texts" if text else "numbers"
            raise InputError(
                f"{self.path}: column {key(name)}: {column.reason or 'numbers'}, expected {expected}"
            )
        return read(part)


def _order(series: Mapping[str, Series]) -> list[str]:
    """Return the columns of one source, a matrix among them as one; nothing for several sources."""
    if len({column.source for column in series.values()}) > 1:
        return []
    matrices = {name: match[1] for name in series if (match := _OF_MATRIX.fullmatch(name))}
    if len(set(matrices.values())) == 1 and len(matrices) == len(series):
        return list(series)
    return list(dict.fromkeys(matrices.get(name, name) for name in series))


def select_table(path: Path, series: Mapping[str, Series], table: str | int | None) -> Mapping[str, Series]:
    """Return what lies in a struct, a group or an array, without its name.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if table is None:
        return series
    name = str(table).strip("/").replace("/", ".")
    members = {k.removeprefix(f"{name}."): column for k, column in series.items() if k.startswith(f"{name}.")}
    if not members:
        members = {k[len(name) + 1 : -1]: column for k, column in series.items() if k.startswith(f"{name}[")}
    if not members and name in series and series[name].column.size is None:
        raise InputError(f"{path}: table {table!r}: {series[name].column.reason}, expected a struct or group")
    if not members:
        names = dict.fromkeys(k.rpartition("[" if k.endswith("]") else ".")[0] for k in series)
        available = ", ".join(name for name in names if name and not name.endswith(" ")) or "none"
        raise InputError(f"{path}: no table {table!r}, expected a struct or group; there are: {available}")
    return members


def series_of(name: str, array: Any, unit: str | None = None) -> dict[str, Series]:
    """Return the columns that an array makes.

    Parameters
    ----------
    name : str
        Its name: that of a column if it is a row; column k of a matrix is ``name[k]``, where time goes along
        the longer axis; a field of records is ``name.field``.
    array : numpy.ndarray or h5py.Dataset
        Of any shape and type.
    unit : str or None
        As the file states it.
    """
    if array.dtype.names == ("real", "imag"):  # of MATLAB 7.3
        return {name: Series(Column(None, unit, _KINDS["c"]), source=name)}
    if array.dtype.names:
        series: dict[str, Series] = {}
        for member in array.dtype.names:
            columns = series_of(f"{name}.{member}" if name else member, field(array, member), unit)
            series |= {column: replace(values, field=member) for column, values in columns.items()}
        return {column: replace(values, source=name) for column, values in series.items()}
    return {column: replace(values, source=name) for column, values in _plain(name, array, unit).items()}


def _plain(name: str, array: Any, unit: str | None) -> dict[str, Series]:
    """Return the columns of an array that has no fields."""
    is_text = array.dtype.kind in _TEXTS or _is_string(array)
    if not is_text and array.dtype.kind not in (*_NUMBERS, "M"):
        return {name: Series(Column(None, unit, _KINDS.get(array.dtype.kind, str(array.dtype))))}
    if array.dtype.kind == "S" and array.dtype.itemsize == 1 and array.ndim == 2:  # letters, as in netCDF
        read = _letters(array)
        return {name: Series(Column(array.shape[0], unit, "text", text=True), read)}
    shape = [n for n in array.shape if n != 1]
    if array.ndim == 0 or len(shape) > 2 or 0 in shape:
        description = (
            f"an array of shape {array.shape}" if array.ndim else "text" if is_text else "a single value"
        )
        description = "empty" if 0 in shape else description
        return {name: Series(Column(None, unit, description))}
    if len(shape) < 2:
        return {name: row(array, unit, int(np.argmax(array.shape)), {})}
    return _matrix(name, array, unit)


def _matrix(name: str, array: Any, unit: str | None) -> dict[str, Series]:
    axes = [axis for axis, n in enumerate(array.shape) if n != 1]
    if isinstance(array, h5py.Dataset) and "MATLAB_class" in array.attrs:  # stored column by column
        axes.reverse()
    time = axes[0] if array.shape[axes[0]] >= array.shape[axes[1]] else axes[1]
    (column_axis,) = set(axes) - {time}
    count = array.shape[column_axis]
    if count > MOST_COLUMNS:
        return {name: Series(Column(None, unit, f"a matrix of shape {array.shape}"))}
    names = [f"{name}[{k + 1}]" if name else f"{k + 1}" for k in range(count)]
    return {names[k]: row(array, unit, time, {column_axis: k}) for k in range(count)}


def row(array: Any, unit: str | None, time: int, index: Mapping[int, int]) -> Series:
    """Return an array along its axis `time`, at places of other axes, or at 0."""

    def read(part: slice) -> Any:
        return array[tuple(part if axis == time else index.get(axis, 0) for axis in range(array.ndim))]

    if array.dtype.kind == "M":
        return Series(
            Column(array.shape[time], None, "text", text=True),
            lambda part: np.datetime_as_string(np.asarray(read(part))),
        )
    is_text = array.dtype.kind not in _NUMBERS
    column = Column(array.shape[time], unit, "text" if is_text else "", text=is_text)
    return Series(column, read, dtype=array.dtype)


def _letters(array: Any) -> Callable[[slice], Any]:
    return lambda part: [b"".join(row) for row in np.asarray(array[part])]


def _is_string(array: Any) -> bool:
    return array.dtype.kind == "O" and h5py.check_string_dtype(array.dtype) is not None


class _Field:
    """A field of a dataset of records, read when it is asked for."""

    def __init__(self, dataset: h5py.Dataset, name: str) -> None:
        self._dataset, self._name = dataset, name
        kind = dataset.dtype[name]
        self.dtype, self.shape = kind.base, (*dataset.shape, *kind.shape)
        self.ndim = len(self.shape)

    def __getitem__(self, index: tuple[Any, ...]) -> Any:
        depth = self._dataset.ndim
        rows = self._dataset.fields(self._name)[index[:depth]]
        return rows[tuple(slice(None) for part in index[:depth] if isinstance(part, slice)) + index[depth:]]


def field(array: Any, name: str) -> Any:
    """Return a field of records, of a dataset without reading it."""
    return _Field(array, name) if isinstance(array, h5py.Dataset) else array[name]


def _text(value: object) -> str:
    """Return a text as str; MATLAB and FITS fill it up with blanks."""
    text = value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
    text = text.rstrip("\x00 ")
    return "" if text == "NaT" else text
