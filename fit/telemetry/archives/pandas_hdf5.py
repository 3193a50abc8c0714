"""Data frames that pandas writes to HDF5, in its formats "fixed" and "table"."""

import pickletools
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import h5py
import numpy as np

from fit.telemetry.archives.arrays import LazyArray, columns_of
from fit.telemetry.archives.table import Column
from fit.telemetry.validation import plain, storage_fault

_NAMES = ("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "INT", "BININT", "BININT1", "BININT2")
#: What a group raises that has the attributes of pandas, but not what pandas writes.
_MISFITS = (KeyError, AttributeError, TypeError, ValueError, OverflowError)


def frame_columns(name: str, group: h5py.Group) -> dict[str, Column] | None:
    """Return the columns of a data frame, ``name.column`` and ``name.index``; None if a group is none.

    Times are texts; what pandas pickled is not read.
    """
    kind = str(plain(group.attrs.get("pandas_type", "")))
    read = {"frame": _frame, "series": _series}.get(kind)
    table = group.get("table")
    if kind.endswith("_table") and isinstance(table, h5py.Dataset) and table.dtype.names:
        read = _table
    if read is None:
        return None
    try:
        datasets = [item for item in group.values() if isinstance(item, h5py.Dataset)]
        if fault := next(filter(None, map(storage_fault, datasets)), ""):
            return {name: Column(reason=f"a data frame of pandas in {fault}", source=name)}
        columns = read(group)
    except _MISFITS:
        return None
    return {f"{name}.{column}": replace(values, source=name) for column, values in columns.items()}


def _frame(group: h5py.Group) -> dict[str, Column]:
    columns: dict[str, Column] = {}
    for i in range(int(group.attrs["nblocks"])):
        dataset, items = group[f"block{i}_values"], _labels(group[f"block{i}_items"])
        kind, by_rows = plain(dataset.attrs.get("value_type", "")), bool(dataset.attrs.get("transposed"))
        columns |= _block(LazyArray.wrap(dataset), items, kind, by_rows=by_rows)
    order = _labels(group["axis0"])
    index = group["axis1"]
    index_column = _column(LazyArray.wrap(index), plain(index.attrs.get("kind", "")))
    return {"index": index_column, **{label: columns[label] for label in order if label in columns}}


def _series(group: h5py.Group) -> dict[str, Column]:
    index, values = group["index"], group["values"]
    return {
        "index": _column(LazyArray.wrap(index), plain(index.attrs.get("kind", ""))),
        "values": _column(LazyArray.wrap(values), plain(values.attrs.get("value_type", ""))),
    }


def _table(group: h5py.Group) -> dict[str, Column]:
    attributes, table = group["table"].attrs, LazyArray.wrap(group["table"])
    columns: dict[str, Column] = {}
    for field in table.dtype.names or ():
        values = table.field(field)
        kind = plain(attributes.get(f"{field}_kind" if field == "index" else f"{field}_dtype", ""))
        labels = _pickled(attributes.get(f"{field}_kind")) if field != "index" else []
        if len(values.shape) == 2 and len(labels) == values.shape[1]:
            columns |= _block(values, labels, kind, by_rows=True)
        elif len(values.shape) == 1:
            columns[labels[0] if len(labels) == 1 else field] = _column(values, kind)
        else:
            columns |= columns_of(field, values)
    _, *labels = _pickled(group.attrs.get("non_index_axes")) or [""]  # the number of the axis, its labels
    order = ["index", *labels]
    return {label: columns[label] for label in (*(o for o in order if o in columns), *columns)}


def _block(values: LazyArray, labels: list[str], kind: object, *, by_rows: bool) -> dict[str, Column]:
    """Return the columns of a matrix whose rows, or else columns, are samples."""
    time = 0 if by_rows else 1
    if len(values.shape) != 2 or values.shape[1 - time] != len(labels) or not _is_stored(values):
        return {label: Column(reason="objects that Python has pickled") for label in labels}
    rows = [values.row(time, {1 - time: k}) for k in range(len(labels))]
    return {label: _timed(row, kind) for label, row in zip(labels, rows, strict=True)}


def _column(values: LazyArray, kind: object) -> Column:
    if len(values.shape) != 1 or not _is_stored(values):
        return Column(reason="objects that Python has pickled")
    return _timed(values.row(0, {}), kind)


def _is_stored(values: LazyArray) -> bool:
    """Return whether values are numbers or texts that lie in the file."""
    return values.dtype.kind in "iufbS"


def _timed(column: Column, kind: object) -> Column:
    """Return times as texts and durations with their unit, where integers count them."""
    name, _, unit = str(kind).removesuffix("]").partition("[")
    read, unit = column.read, unit.partition(",")[0] or "ns"
    if read is None or name not in ("datetime64", "timedelta64"):
        return column
    np.datetime_data(f"M8[{unit}]")  # refuses a unit that is none
    if name == "timedelta64":
        return replace(column, unit=unit)

    def texts() -> Any:
        return np.datetime_as_string(np.asarray(read()).astype("i8").view(f"M8[{unit}]"))

    return replace(column, reason="text", is_text=True, read=texts)


def _labels(items: h5py.Dataset) -> list[str]:
    return [item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item) for item in items[()]]


def _pickled(value: object) -> list[str]:
    """Return the texts and numbers of a pickled list without unpickling it, which may run anything."""
    if not isinstance(value, bytes):
        return []
    try:
        return [str(argument) for argument in _arguments(pickletools.genops(value))]
    except ValueError:
        return []


def _arguments(operations: Iterable[tuple[Any, Any, Any]]) -> Iterable[object]:
    return (argument for code, argument, _ in operations if code.name in _NAMES)
