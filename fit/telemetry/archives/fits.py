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
from fit.telemetry.archives.arrays import Arrays, Series, series_of
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
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
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
                chosen = [hdu for i, hdu in tables.items() if table in (None, i, hdu.name)]
                series = _series(chosen[0]) if chosen else {}
        except Exception as error:  # a damaged file makes it raise almost anything
            raise read_error(path, error, "FITS") from error
        if not chosen:
            available = ", ".join(hdu.name or str(i) for i, hdu in tables.items()) or "none"
            requested = "table" if table is None else f"table {table!r}"
            raise InputError(
                f"{path}: no {requested}, expected an extension with a table; there are: {available}"
            )
        yield Arrays(path, "FITS", series)


def _check_sum(path: Path) -> None:
    """Read a compressed file to its end, where its checksum stands; astropy stops before that."""
    with gzip.open(path) as packed:
        while packed.read(_PIECE):
            pass


def _series(hdu: Any) -> dict[str, Series]:
    """Return the columns of a table."""
    stored = hdu.data.view(np.ndarray)  # before TSCAL, TZERO and TNULL
    series: dict[str, Series] = {}
    for column in hdu.columns:
        kind = column.format.lstrip("0123456789")[:1]
        is_ascii = column.start is not None
        if not is_ascii and kind in _REFUSED:
            series[column.name] = Series(Column(None, column.unit, _REFUSED[kind]))
        elif kind == "A":
            series |= series_of(column.name, np.char.strip(stored[column.name]))
        elif is_ascii:
            series |= series_of(column.name, _ascii_numbers(stored[column.name], column), column.unit)
        else:
            series |= series_of(column.name, _numbers(hdu, stored, column), column.unit)
    return {name: replace(column, source=hdu.name) for name, column in series.items()}


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
