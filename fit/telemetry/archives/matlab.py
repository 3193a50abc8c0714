"""MATLAB .mat files of every version, with objects of MATLAB and of LTPDA, by mat-io."""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fit.telemetry.archives import tables
from fit.telemetry.archives.columns import Column, Table, columns_of, unreadable

_HDF5 = b"\x89HDF"
_DEEPEST = 20  # structs in structs; objects may contain each other
_MOST_ITEMS = 100  # of an array of structs, objects or cells
_REFERENCE = 0xDD000000  # what an object that mat-io cannot find begins with


@contextmanager
def open_matlab(path: Path) -> Iterator[Table]:
    """Open a .mat file.

    A property `y` of an object in the property `data` of the variable `a` is ``a.data.y``. Times are texts.
    """
    with path.open("rb") as file:
        is_hdf5 = file.read(len(_HDF5)) == _HDF5  # without the header of MATLAB
    if is_hdf5:
        with tables.open_hdf5(path) as table:
            yield table
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import matio  # takes its time

        variables = matio.load_from_mat(path)
    columns: dict[str, Column] = {}
    for name, value in variables.items():
        columns |= _flat(name, value)
    yield Table(path, columns)


def _flat(name: str, value: Any, depth: int = 0) -> dict[str, Column]:
    """Return the columns of a value, be it struct, object, table or array, in `depth` others."""
    if depth > _DEEPEST:
        return {}
    members = _members(value)
    if members is not None:
        columns: dict[str, Column] = {}
        for member, inner in members:
            columns |= _flat(f"{name}.{member}", inner, depth + 1)
        return columns or {name: unreadable(f"of class {getattr(value, 'classname', 'struct')}, empty")}
    if not isinstance(value, np.ndarray):
        return {name: unreadable("a single value")}
    if value.dtype.kind in "OV":
        items = value.ravel().tolist() if value.dtype.kind == "O" else list(value.ravel())
        if len(items) == 1:
            return _flat(name, items[0], depth + 1)
        texts = [item.item() if isinstance(item, np.ndarray) and item.size == 1 else item for item in items]
        if items and all(isinstance(text, str) for text in texts):
            return _of_array(name, np.array(texts))
        columns = {}
        for k, item in enumerate(items if len(items) <= _MOST_ITEMS else [], 1):
            columns |= _flat(f"{name}[{k}]", item, depth + 1)
        return columns or {name: unreadable("a cell array")}
    if value.dtype == np.uint32 and value.size and value.flat[0] == _REFERENCE:
        return {name: unreadable("an object that mat-io cannot read; save it from MATLAB as a struct")}
    if value.dtype.kind == "m":  # durations
        return _of_array(name, value / np.timedelta64(1, "s"), "s")
    return _of_array(name, value)


def _of_array(name: str, values: Any, unit: str | None = None) -> dict[str, Column]:
    return columns_of(name, values, partial(np.asarray, values), unit)


def _members(value: Any) -> Iterable[tuple[str, Any]] | None:
    """Return what is in a struct or an object by name, None if the value is neither."""
    if isinstance(value, dict):
        return value.items()
    if isinstance(properties := getattr(value, "properties", None), dict):
        return properties.items()
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        value = value.ravel()[0]
    if isinstance(value, np.void) and value.dtype.names:
        return ((field, value[field]) for field in value.dtype.names)
    return None
