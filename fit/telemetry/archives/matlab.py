"""MATLAB .mat files: versions 4 to 7 by SciPy, 7.3 as HDF5."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy

from fit.telemetry.archives import hdf5, matlab_objects
from fit.telemetry.archives.arrays import select_table
from fit.telemetry.archives.table import Column, Table, read_error

SUFFIXES = (".mat",)
_NAMELESS = "None"  # as SciPy calls every variable that is an object


@contextmanager
def open_table(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open a .mat file; `table` names a struct, an object or a matrix."""
    if h5py.is_hdf5(path):
        with hdf5.open_table(path, table) as archive:
            yield archive
    else:
        yield Table(path, "a MATLAB file", select_table(path, _columns(path), table))


def _columns(path: Path) -> dict[str, Column]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = scipy.io.loadmat(path, simplify_cells=True)
    except Exception as error:  # a damaged file makes it raise almost anything
        raise read_error(path, error, "a MATLAB file") from error
    columns: dict[str, Column] = {}
    classes: dict[str, str] = {}
    for name, value in values.items():
        kind = _class(value)
        if kind is not None and name == _NAMELESS:
            variable = str(value.ravel()[0]["s0"], "utf-8", "replace")
            classes |= matlab_objects.classes(path, set(values)) or {variable: kind}
        elif kind is not None:
            classes[name] = kind
        elif not name.startswith("__"):
            columns |= matlab_objects.flatten(name, value)
    return columns | (matlab_objects.object_columns(path, classes) if classes else {})


def _class(value: Any) -> str | None:
    """Return the class of the first object in a value of SciPy, which reads none; None without one."""
    if isinstance(value, dict):
        return next((kind for member in value.values() if (kind := _class(member))), None)
    if isinstance(value, np.ndarray) and value.dtype.names and "s2" in value.dtype.names:
        return str(value.ravel()[0]["s2"], "utf-8", "replace")
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        return next((kind for member in value.ravel() if (kind := _class(member))), None)
    return None
