"""A table of an archive: columns by name, each a row of numbers or of texts."""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, quote
from fit.files import closest_match
from fit.files import key as shown_key
from fit.units import in_base_units

MOST_COLUMNS = 1000  # of a matrix
#: Words for a missing sample, beside "nan" and nothing: those of pandas, R and Excel.
MISSING = ("", "NA", "N/A", "n/a", "#N/A", "<NA>", "NULL", "null", "None", "--")
_UNIT = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]+)\]|\((?P<round>(?:[^()]|\([^()]*\))+)\))\s*")


@dataclass(frozen=True)
class Column:
    """A column of an archive.

    Attributes
    ----------
    read : callable
        Returns all rows, numbers or texts, shape (N,); NaN for missing numbers. It raises ValueError where
        the column is no row of either.
    unit : str or None
        As the file states it.
    epoch : str
        Of times that count from it, as in netCDF, "2016-04-16 00:00:00"; empty for others.
    """

    read: Callable[[], NDArray[Any]]
    unit: str | None = None
    epoch: str = ""


def unreadable(reason: str) -> Column:
    """Return what is no row of numbers or texts, but "an array of shape (3, 4, 5)"."""

    def read() -> NDArray[Any]:
        raise ValueError(reason)

    return Column(read)


@dataclass(frozen=True)
class Table:
    """One table of an archive.

    Attributes
    ----------
    path : Path
        The archive.
    columns : mapping of str to Column
        By name. The names of structs and groups stand before those of what they contain, joined by dots;
        column k of a matrix `out` is ``out[k]``, counted from 1.
    has_order : bool
        Whether a column may be called by its number.
    """

    path: Path
    columns: Mapping[str, Column]
    has_order: bool = False

    def unit(self, name: str) -> str | None:
        """Return the unit of a column, as the file or the name in brackets states it."""
        return self.columns[name].unit or split_unit(name)[1]

    def place(self, name: str | int, channel: str = "") -> str:
        """Return file and column for messages, the channel that it is for included."""
        meaning = f" (channel {channel})" if channel else ""
        shown = name if str(name).isprintable() and len(str(name)) <= 80 else shown_key(str(name))
        return f"{self.path}: column {shown}{meaning}"

    def read(self, name: str) -> NDArray[Any]:
        """Return a column as float64, or as texts without the blanks behind them.

        Raises
        ------
        InputError
            If it is no row of either, or damaged.
        """
        with read_errors(self.place(name), "a row of numbers"):
            values = self.columns[name].read()
        if values.dtype.kind in "iufb":
            return values.astype(np.float64)
        return np.array([_text(value) for value in values.tolist()], dtype=object)

    def column(self, key: str | int, channel: str = "") -> str:
        """Return the name of a column.

        Parameters
        ----------
        key : str or int
            Its name, its name without the unit in brackets that follows, or its number, counted from 1.
        channel : str
            What the column is for, for the message.

        Raises
        ------
        InputError
            If there is no such column, or several.
        """
        names = list(self.columns)
        if isinstance(key, int) and self.has_order:
            names = names[key - 1 : key]
        elif key not in names:
            path = str(key).strip("/").replace("/", ".")  # as HDF5 writes it
            names = [name for name in names if path in (name, split_unit(name)[0])]
        else:
            return str(key)
        if len(names) != 1:
            known = closest_match(str(key), {split_unit(name)[0] for name in self.columns})
            raise InputError(f"{self.place(key, channel)}: {'several' if names else 'missing'}{known[:300]}")
        return names[0]

    def has(self, key: str | int) -> bool:
        """Return whether there is such a column, and only one."""
        try:
            self.column(key)
        except InputError:
            return False
        return True

    def select(self, table: str | int | None) -> "Table":
        """Return what lies in a struct, a group or a matrix, without its name; None stands for all.

        Raises
        ------
        InputError
            If there is none of this name.
        """
        if table is None:
            return self
        name = str(table).strip("/").replace("/", ".")
        for begin, end in ((f"{name}.", 0), (f"{name}[", 1)):
            members = [k for k in self.columns if k.startswith(begin)]
            if members:
                columns = {k[len(begin) : len(k) - end]: self.columns[k] for k in members}
                return Table(self.path, columns, has_order=bool(end))
        groups = {k.rpartition(".")[0] for k in self.columns if "." in k}
        raise InputError(f"{self.path}: no table {table!r}{closest_match(name, groups)[:300]}")


def columns_of(
    name: str, values: NDArray[Any] | h5py.Dataset, load: Callable[[], Any], unit: str | None = None
) -> dict[str, Column]:
    """Return the columns that an array makes.

    Parameters
    ----------
    name : str
        Its name: that of a column if it is a row; column k of a matrix is ``name[k]``, where time goes along
        the longer axis; a field of records is ``name.field``.
    values : array or dataset
        Of any shape and type.
    load : callable
        Returns the values.
    unit : str or None
        As the file states it.
    """
    return _columns(name, values.dtype, values.shape, load, unit)


def _columns(
    name: str, kind: np.dtype[Any], shape: tuple[int, ...], load: Callable[[], Any], unit: str | None
) -> dict[str, Column]:
    if kind.names and kind.names != ("real", "imag"):
        fields: dict[str, Column] = {}
        for field in kind.names:
            part, of_field = kind[field], partial(lambda field: load()[field], field)
            fields |= _columns(f"{name}.{field}", part.base, (*shape, *part.shape), of_field, unit)
        return fields
    axes = [n for n in shape if n != 1]
    is_row = kind.kind in "iufbMSUT" or h5py.check_string_dtype(kind) is not None
    if not is_row or not shape or 0 in shape or len(axes) > 2 or (axes[1:] and min(axes) > MOST_COLUMNS):
        return {name: unreadable(f"{kind} of shape {shape}")}
    if len(axes) < 2:
        return {name: Column(partial(_row, load, None), unit)}
    return {f"{name}[{k + 1}]": Column(partial(_row, load, k), unit) for k in range(min(axes))}


def _row(load: Callable[[], Any], k: int | None) -> NDArray[Any]:
    """Return a row of numbers or texts, or column k of a matrix whose longer axis is time."""
    values = np.asarray(load())
    if values.dtype.kind == "M":
        values = np.datetime_as_string(values)
    if k is None:
        return values.reshape(-1)
    matrix = values.squeeze()
    return np.asarray(matrix[:, k] if matrix.shape[0] >= matrix.shape[1] else matrix[k])


def _text(value: object) -> str:
    """Return a text as str; MATLAB and FITS fill it up with blanks."""
    text = value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
    return text.rstrip("\x00 ")


def split_unit(name: str) -> tuple[str, str | None]:
    """Return a name without the unit in brackets at its end, and that unit.

    Examples
    --------
    >>> split_unit("x12 [nm]"), split_unit("a1 (pm/s^2)"), split_unit("out[2]"), split_unit("x (raw)")
    (('x12', 'nm'), ('a1', 'pm/s^2'), ('out[2]', None), ('x (raw)', None))
    """
    match = _UNIT.fullmatch(name)
    if match is None:
        return name, None
    unit = (match["square"] or match["round"]).strip()
    if unit.isdecimal() or (match["square"] is None and not is_unit(unit)):
        return name, None
    return match["name"], clean_unit(unit)


def clean_unit(text: str) -> str | None:
    """Return a unit without brackets around it, as LTPDA writes them; None if it says that there is none."""
    unit = text.strip()
    if unit and unit[0] + unit[-1] in ("[]", "()"):
        unit = unit[1:-1].strip()
    return None if unit in ("-", "1", *MISSING) else unit


def is_unit(text: str) -> bool:
    """Return whether a text is a unit that is known."""
    try:
        in_base_units(text)
    except ValueError:
        return False
    return True


@contextmanager
def read_errors(place: str, expected: str) -> Iterator[None]:
    """Turn whatever a library raises of a damaged file into an `InputError`."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = " ".join((str(error) or type(error).__name__).split())
        reason = reason if reason.isprintable() and len(reason) <= 300 else quote(reason)
        raise InputError(f"{place}: cannot be read ({reason}), expected {expected}") from error
