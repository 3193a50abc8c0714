"""NumPy's .npy and .npz."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fit.telemetry.archives.arrays import Arrays, select_table, series_of
from fit.telemetry.archives.table import Table, read_error

SUFFIXES = (".npy", ".npz")


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open an array, whose columns are fields or numbers, or a set of arrays, of which `table` names one."""
    try:
        loaded = np.load(path, mmap_mode=None if zipfile.is_zipfile(path) else "r", allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            series = {name or "1": column for name, column in series_of("", loaded).items()}
        else:
            with loaded:
                arrays = {name: loaded[name] for name in loaded.files}
            series = {
                k: column for name, array in arrays.items() for k, column in series_of(name, array).items()
            }
    except Exception as error:  # a damaged file makes it raise almost anything
        raise read_error(path, error, "arrays of NumPy without pickled objects") from error
    yield Arrays(path, "arrays of NumPy", select_table(path, series, table))
