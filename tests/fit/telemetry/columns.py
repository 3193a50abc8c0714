"""Columns of archives that tests write, and what they read of them."""

import pickle

import h5py
import numpy as np
import pytest

from fit.errors import InputError
from fit.telemetry.archives import open_table

N = 40
T, X, Y = np.arange(N) / 2, 1e-9 * np.arange(N) ** 2, -3.0 * np.arange(N)
OUT = np.column_stack([T, X, Y])
WHEN = np.datetime64("2016-04-16T14:00:00", "ns") + (1e9 * T).astype("m8[ns]")
STAMPS = [str(stamp) for stamp in WHEN]
NAN = float("nan")


def read(path, table=None):
    """All columns of numbers and of texts, by name."""
    columns = {}
    with open_table(path, table) as archive:
        for name, column in archive.columns.items():
            assert (column.size is None or column.is_text) == bool(column.reason), name
            if column.size is not None:
                columns[name] = np.array((archive.texts if column.is_text else archive.numbers)(name))
                assert columns[name].size == column.size
    return columns


def reasons(path):
    with open_table(path, None) as archive:
        return {name: column.reason for name, column in archive.columns.items() if column.size is None}


def units(path):
    with open_table(path, None) as archive:
        return {name: column.unit for name, column in archive.columns.items() if column.unit}


def assert_same(columns, expected):
    assert list(columns) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(columns[name], values, name)


def message(path, key, table=None):
    with open_table(path, table) as archive, pytest.raises(InputError) as error:
        archive.column(key)
    return str(error.value).removeprefix(f"{path}: ")


def pandas_file(path):
    """Write what `to_hdf` of pandas 3 writes of a frame with times, in both of its formats."""
    labels = ["t", "x", "y"]
    with h5py.File(path, "w") as file:
        fixed = file.create_group("fixed")
        fixed.attrs.update({"pandas_type": np.bytes_(b"frame"), "nblocks": 2, "ndim": 2})
        fixed["axis0"] = np.array(labels, "S")
        fixed["axis1"] = WHEN.astype("i8")
        fixed["axis1"].attrs["kind"] = np.bytes_(b"datetime64[ns]")
        for i, items in enumerate((["x"], ["t", "y"])):
            fixed[f"block{i}_items"] = np.array(items, "S")
            fixed[f"block{i}_values"] = OUT[:, [labels.index(item) for item in items]]
            fixed[f"block{i}_values"].attrs["transposed"] = np.uint8(1)
        for name, blocks in (("table", [["t", "x", "y"]]), ("by/columns", [["t"], ["x"], ["y"]])):
            group = file.create_group(name)
            group.attrs["pandas_type"] = np.bytes_(b"frame_table")
            group.attrs["non_index_axes"] = np.bytes_(pickle.dumps([(1, labels)], 0))
            group["_i_table/index/sorted"] = np.zeros((3, 4), "i8")
            fields = [f"values_block_{i}" if len(b) > 1 else b[0] for i, b in enumerate(blocks)]
            kind = [
                ("index", "i8"),
                *((f, "f8", (len(b),) if len(b) > 1 else ()) for f, b in zip(fields, blocks, strict=True)),
            ]
            table = np.zeros(N, kind)
            table["index"] = WHEN.astype("M8[us]").astype("i8")
            for field, block in zip(fields, blocks, strict=True):
                table[field] = OUT if len(block) > 1 else OUT[:, labels.index(block[0])]
            group.create_dataset("table", data=table, chunks=(16,), compression="gzip")
            group["table"].attrs["index_kind"] = np.bytes_(b"datetime64[us]")
            for field, block in zip(fields, blocks, strict=True):
                group["table"].attrs[f"{field}_kind"] = np.bytes_(pickle.dumps(block, 0))
        series = file.create_group("series")
        series.attrs["pandas_type"] = np.bytes_(b"series")
        series["index"], series["values"] = (1e9 * T).astype("i8"), Y
        series["index"].attrs["kind"] = np.bytes_(b"timedelta64[ns]")
