"""FITS: binary and ASCII tables."""

import gzip
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fit.errors import InputError
from fit.telemetry.archives.arrays import LazyArray, columns_of
from fit.telemetry.archives.table import Column, Table, read_error

SUFFIXES = (".fits", ".fit", ".fts", ".fits.gz", ".fit.gz", ".fts.gz")
_PIECE = 2**20  # bytes
_REFUSED = {
    "L": "logical values",
    "X": "bits",
    "C": "complex numbers",
    "M": "complex numbers",
    "P": "rows of different lengths",
    "Q": "rows of different lengths",
}


@contextmanager
def open_table(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open a FITS file; `table` is the name or the number of an extension, None the first table."""
    from astropy.io import fits  # takes its time

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
                name = table.casefold() if isinstance(table, str) else table
                chosen = [hdu for i, hdu in tables.items() if name in (None, i, hdu.name.casefold())]
                columns = _columns(chosen[0]) if chosen else {}
        except Exception as error:  # a damaged file makes it raise almost anything
            raise read_error(path, error, "FITS") from error
        if not chosen:
            available = ", ".join(hdu.name or str(i) for i, hdu in tables.items()) or "none"
            requested = "table" if table is None else f"table {table!r}"
            raise InputError(
                f"{path}: no {requested}, expected an extension with a table; there are: {available}"
            )
        yield Table(path, "FITS", columns)


def _check_sum(path: Path) -> None:
    """Read a compressed file to its end, where its checksum stands; astropy stops before that."""
    with gzip.open(path) as packed:
        while packed.read(_PIECE):
            pass


def _columns(hdu: Any) -> dict[str, Column]:
    """Return the columns of a table."""
    stored = hdu.data.view(np.ndarray)  # before TSCAL, TZERO and TNULL
    columns: dict[str, Column] = {}
    for column in hdu.columns:
        kind = column.format.lstrip("0123456789")[:1]
        is_ascii = column.start is not None
        if not is_ascii and kind in _REFUSED:
            columns[column.name] = Column(None, column.unit, _REFUSED[kind])
            continue
        if kind == "A":
            values, unit = np.char.strip(stored[column.name]), None
        elif is_ascii:
            values, unit = _ascii_numbers(stored[column.name], column), column.unit
        else:
            values, unit = _numbers(hdu, stored, column), column.unit
        columns |= columns_of(column.name, LazyArray.wrap(values), unit)
    return {name: replace(column, source=hdu.name) for name, column in columns.items()}


def _numbers(hdu: Any, stored: Any, column: Any) -> Any:
    """Return a column of a binary table, NaN where an integer stands for a missing value."""
    values = hdu.data[column.name]
    if column.null is None or stored[column.name].dtype.kind not in "iu":
        return values
    return np.where(stored[column.name] == column.null, np.nan, values)


def _ascii_numbers(texts: Any, column: Any) -> Any:
    """Return a column of an ASCII table, NaN where it is blank or the text that stands for a missing value.

    astropy reads both as 0.
    """
    null = b"" if column.null is None else str(column.null).strip().encode()
    cells = np.char.strip(texts)
    missing = (cells == b"") | (cells == null)
    numbers = [float(cell.upper().replace(b"D", b"E")) for cell in np.where(missing, b"nan", cells)]
    return np.array(numbers) * (column.bscale or 1) + (column.bzero or 0)
