"""FITS: table extensions."""

import gzip
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fit.errors import InputError
from fit.telemetry.archives.arrays import Arrays
from fit.telemetry.archives.table import Table, damaged

SUFFIXES = (".fits", ".fit", ".fits.gz")
_PIECE = 2**20  # bytes


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
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
                columns = list(chosen[0].columns) if chosen else []
                arrays = {column.name: _field(chosen[0], column) for column in columns}
        except Exception as error:  # a damaged file makes it raise almost anything
            raise damaged(path, error) from error
        if not chosen:
            there = ", ".join(hdu.name or str(i) for i, hdu in tables.items()) or "none"
            wanted = "table" if table is None else f"table {table!r}"
            raise InputError(f"{path}: no {wanted}, expected an extension with a table; there are: {there}")
        yield Arrays(path, arrays, {column.name: column.unit for column in columns})


def _check_sum(path: Path) -> None:
    """Read a compressed file to its end, where its checksum stands; astropy stops before that."""
    with gzip.open(path) as packed:
        while packed.read(_PIECE):
            pass


def _field(hdu: Any, column: Any) -> Any:
    """Return a column of a FITS table, NaN where an integer stands for a missing value."""
    values = hdu.data[column.name]
    if column.null is None or values.dtype.kind not in "iuf":
        return values
    null = column.null * (column.bscale or 1) + (column.bzero or 0)
    return np.where(values == null, np.nan, values)
