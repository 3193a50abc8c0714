"""NumPy's .npy and .npz."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fit.telemetry.archives.arrays import LazyArray, columns_of, select_table
from fit.telemetry.archives.table import Column, Table, read_error

SUFFIXES = (".npy", ".npz")


@contextmanager
def open_table(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open an array, whose columns are fields or numbers, or a set of arrays, of which `table` names one."""
    try:
        loaded = np.load(path, mmap_mode=None if zipfile.is_zipfile(path) else "r", allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            array = LazyArray.wrap(loaded)
            columns = {name or "1": column for name, column in columns_of("", array).items()}
        else:
            with loaded:
                columns = {k: c for name in loaded.files for k, c in _member_columns(loaded, name).items()}
    except Exception as error:  # a damaged file makes it raise almost anything
        raise read_error(path, error, "arrays of NumPy without pickled objects") from error
    yield Table(path, "arrays of NumPy", select_table(path, columns, table))


def _member_columns(archive: Mapping[str, np.ndarray], name: str) -> dict[str, Column]:
    """Return the columns of an array of a set; of pickled objects none can be read."""
    try:
        return columns_of(name, LazyArray.wrap(archive[name]))
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        return {name: Column(reason="pickled objects", source=name)}
