"""NumPy's .npy and .npz."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fit.telemetry.archives.arrays import LazyArray, columns_of, select_table
from fit.telemetry.archives.table import Table, read_error

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
                arrays = {name: LazyArray.wrap(loaded[name]) for name in loaded.files}
            columns = {
                k: column for name, array in arrays.items() for k, column in columns_of(name, array).items()
            }
    except Exception as error:  # a damaged file makes it raise almost anything
        raise read_error(path, error, "arrays of NumPy without pickled objects") from error
    yield Table(path, "arrays of NumPy", select_table(path, columns, table))
