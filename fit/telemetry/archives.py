"""Tables of telemetry as archives keep them: CSV, MATLAB .mat, FITS.

Whatever the format, a table is columns by name, each a row of numbers in which a missing value is NaN.
Every function raises `fit.errors.InputError`; its message names the file, the place and what was expected.
"""

import csv
import gzip
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import h5py
import numpy as np
import scipy
from numpy.typing import NDArray

from fit.errors import InputError
from fit.files import is_file, key
from fit.telemetry.datasets import check_storage

Array = NDArray[np.float64]

_TEXT = (".csv", ".tsv", ".txt", ".dat")
_LONGEST_LINE = 2**20  # letters
BLOCK = 2**14  # samples held at a time


@dataclass(frozen=True)
class Column:
    """What is known of a column before it is read.

    Attributes
    ----------
    size : int or None
        Number of samples, None if it is no row of numbers.
    unit : str or None
        As the file states it.
    """

    size: int | None
    unit: str | None = None


class Table(ABC):
    """One table of an archive.

    Attributes
    ----------
    columns : mapping of str to Column
        By name; what lies in a MATLAB struct has the names of the structs and dots before its own.
    """

    columns: Mapping[str, Column]

    @abstractmethod
    def blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        """Yield columns that are rows of numbers of one length, up to `BLOCK` samples at a time."""


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open an archive for reading.

    Parameters
    ----------
    path : Path
        Its suffix tells the format.
    table : str, int or None
        Struct of a .mat file, name or number of the extension of a FITS file; None: all of the variables, the
        first table.

    Raises
    ------
    InputError
        If the file cannot be read, is of no known format or has no such table.
    """
    reader = next((r for suffixes, r in _READERS.items() if path.name.lower().endswith(suffixes)), None)
    if reader is None:
        known = ", ".join(suffix for suffixes in _READERS for suffix in suffixes)
        raise InputError(f"{path}: of no known format, expected a name that ends in one of {known}")
    if not is_file(path):
        raise InputError(f"{path}: no such file, expected a table of telemetry")
    try:
        with reader(path, table) as found:
            yield found
    except (OSError, RuntimeError, csv.Error) as error:
        raise _damaged(path, error) from error


def look(path: Path, table: str | int | None) -> None:
    """Read all rows of numbers of a table; InputError as `opened`."""
    with opened(path, table) as found:
        rows: dict[int, list[str]] = {}
        for name, column in found.columns.items():
            if column.size is not None:
                rows.setdefault(column.size, []).append(name)
        for names in rows.values():
            for _ in found.blocks(names):
                pass


def is_text(path: Path) -> bool:
    """Tell whether an archive is text, which no library but Python's own reads."""
    return path.name.lower().endswith(_TEXT)


def _damaged(path: Path, error: Exception) -> InputError:
    why = str(error).partition("\n")[0][:200]
    return InputError(f"{path}: cannot be read ({why}), expected a table of telemetry")


class _Text(Table):
    """Lines of cells separated by tabs, semicolons, commas or blanks, below a line with the names."""

    def __init__(self, file: TextIO, path: Path) -> None:
        self._file, self._path = file, path
        self._first, comment, line = 1, "", ""
        for number, text in self._numbered():
            if _is_data(text):
                self._first, line = number, text
                break
            comment = text.lstrip("# ") if text.strip() else comment
        self._delimiter = next((d for d in "\t;," if d in line), " ")
        cells = next(self._rows([line]), [])
        if all(map(_is_number, cells)):  # then the names stand in the last comment
            cells = next(self._rows([comment]), [])
        else:
            self._first += 1
        self._names = [cell.strip() for cell in cells]
        size = sum(1 for _ in self._lines())
        self.columns = {name: Column(size) for name in self._names}
        for name in self.columns:
            if self._names.count(name) > 1:
                raise InputError(f"{path}: column {name}: there are several, expected one of each name")

    def blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        lines = self._lines()
        while block := list(islice(lines, BLOCK)):
            rows = list(self._rows([text for _, text in block]))
            for (number, _), row in zip(block, rows, strict=False):
                if len(row) != len(self._names):
                    raise InputError(
                        f"{self._path}: line {number}: {len(row)} cells, expected the {len(self._names)} of "
                        "the line with the names"
                    )
            columns = list(zip(*rows, strict=True))
            yield [self._numbers(block, columns[self._names.index(name)], name) for name in names]

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of every line of data."""
        numbered = self._numbered()
        return ((number, text) for number, text in numbered if number >= self._first and _is_data(text))

    def _numbered(self) -> Iterator[tuple[int, str]]:
        self._file.seek(0)
        for number, text in enumerate(iter(lambda: self._file.readline(_LONGEST_LINE), ""), 1):
            if len(text) == _LONGEST_LINE:
                raise InputError(
                    f"{self._path}: line {number}: {_LONGEST_LINE} letters or more, expected a row of cells"
                )
            yield number, text

    def _rows(self, lines: Sequence[str]) -> Iterator[list[str]]:
        blank = self._delimiter == " "
        texts = (text.strip() if blank else text for text in lines)
        return csv.reader(texts, delimiter=self._delimiter, skipinitialspace=True)

    def _numbers(self, block: Sequence[tuple[int, str]], cells: Sequence[str], name: str) -> Array:
        try:
            return np.array([float(cell) for cell in cells])
        except ValueError:  # an empty cell is a missing sample
            for (number, _), cell in zip(block, cells, strict=True):
                if not _is_number(cell):
                    raise InputError(
                        f"{self._path}: line {number}: column {name}: {cell!r}, expected a number with a "
                        "decimal point, or nothing"
                    ) from None
            return np.array([float(cell) if cell.strip() else np.nan for cell in cells])


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip() or "nan")
    except ValueError:
        return False
    return True


class _Arrays(Table):
    """Arrays of NumPy or HDF5 by name; a single row or column of a matrix is a row of numbers."""

    def __init__(self, arrays: Mapping[str, Any], units: Mapping[str, str | None] | None = None) -> None:
        self._arrays = arrays
        self.columns = {
            name: Column(_length(array), (units or {}).get(name)) for name, array in arrays.items()
        }

    def blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        size = self.columns[names[0]].size or 0
        for start in range(0, size, BLOCK):
            yield [_part(self._arrays[name], slice(start, start + BLOCK)) for name in names]


def _length(array: Any) -> int | None:
    if (
        array.dtype.kind not in "iufb"
        or array.ndim == 0
        or sorted(array.shape)[:-1] != [1] * (array.ndim - 1)
    ):
        return None
    return int(max(array.shape))


def _part(array: Any, part: slice) -> Array:
    axis = int(np.argmax(array.shape))
    return np.asarray(array[tuple(part if i == axis else 0 for i in range(array.ndim))], dtype=np.float64)


@contextmanager
def _text(path: Path, table: str | int | None) -> Iterator[Table]:
    if table is not None:
        raise InputError(f"{path}: no table {table!r}, expected none to be named in a file of one table")
    # Latin letters in columns that nobody reads do no harm.
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        yield _Text(file, path)


@contextmanager
def _matlab(path: Path, table: str | int | None) -> Iterator[Table]:
    if h5py.is_hdf5(path):  # version 7.3
        with h5py.File(path) as file:
            arrays: dict[str, Any] = {}
            file.visititems(lambda name, item: _keep(path, arrays, name, item))
            yield _Arrays(_inside(path, arrays, table))
    else:
        try:
            variables = scipy.io.loadmat(path, simplify_cells=True)
        except Exception as error:  # a damaged file makes it raise almost anything
            raise _damaged(path, error) from error
        named = {name: value for name, value in variables.items() if not name.startswith("__")}
        yield _Arrays(_inside(path, dict(_flat(named)), table))


def _keep(path: Path, arrays: dict[str, Any], name: str, item: object) -> None:
    """Keep a dataset of a .mat file of version 7.3, unless it only stands for letters or nothing."""
    if isinstance(item, h5py.Dataset) and not name.startswith("#"):
        if item.size and item.dtype.kind in "iufb":
            check_storage(item, f"{path}: column {key(name)}")
        marked = item.attrs.get("MATLAB_class") == b"char" or "MATLAB_empty" in item.attrs
        arrays[name.replace("/", ".")] = np.empty(()) if marked else item


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value if isinstance(value, np.ndarray) else np.empty(())


def _inside(path: Path, arrays: Mapping[str, Any], table: str | int | None) -> Mapping[str, Any]:
    """Return what lies in a struct, without its name."""
    if table is None:
        return arrays
    inside = {k.removeprefix(f"{table}."): a for k, a in arrays.items() if k.startswith(f"{table}.")}
    if not inside:
        there = ", ".join(dict.fromkeys(name.rpartition(".")[0] for name in arrays if "." in name)) or "none"
        raise InputError(f"{path}: no table {table!r}, expected a struct; there are: {there}")
    return inside


@contextmanager
def _fits(path: Path, table: str | int | None) -> Iterator[Table]:
    try:
        fits: Any = import_module("astropy.io.fits")
    except ImportError:
        raise InputError(f"{path}: FITS needs the extra lpfcosim[fits]") from None
    with ExitStack() as stack:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # a file cut short is only warned about
                warnings.simplefilter("ignore", fits.verify.VerifyWarning)
                if path.suffix.lower() == ".gz":
                    _check_sum(path)
                file = stack.enter_context(path.open("rb"))
                hdus = stack.enter_context(fits.open(file, memmap=True))
                tables = {i: hdu for i, hdu in enumerate(hdus) if hasattr(hdu, "columns")}
                chosen = [hdu for i, hdu in tables.items() if table in (None, i, hdu.name)]
                columns = list(chosen[0].columns) if chosen else []
                arrays = {column.name: _field(chosen[0], column) for column in columns}
        except Exception as error:  # a damaged file makes it raise almost anything
            raise _damaged(path, error) from error
        if not chosen:
            there = ", ".join(hdu.name or str(i) for i, hdu in tables.items()) or "none"
            wanted = "table" if table is None else f"table {table!r}"
            raise InputError(f"{path}: no {wanted}, expected an extension with a table; there are: {there}")
        yield _Arrays(arrays, {column.name: column.unit for column in columns})


def _check_sum(path: Path) -> None:
    """Read a compressed file to its end, where its checksum stands; astropy stops before that."""
    with gzip.open(path) as packed:
        while packed.read(_LONGEST_LINE):
            pass


def _field(hdu: Any, column: Any) -> Any:
    """Return a column of a FITS table, NaN where an integer stands for a missing value."""
    values = hdu.data[column.name]
    if column.null is None or values.dtype.kind not in "iuf":
        return values
    null = column.null * (column.bscale or 1) + (column.bzero or 0)
    return np.where(values == null, np.nan, values)


_Reader = Callable[[Path, str | int | None], AbstractContextManager[Table]]
_READERS: Mapping[tuple[str, ...], _Reader] = {
    _TEXT: _text,
    (".mat",): _matlab,
    (".fits", ".fit", ".fits.gz"): _fits,
}
