"""MATLAB .mat files of every version."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy

from fit.errors import InputError
from fit.files import key
from fit.telemetry.archives.arrays import Arrays
from fit.telemetry.archives.table import Table, damaged
from fit.telemetry.datasets import check_storage

SUFFIXES = (".mat",)


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
    if h5py.is_hdf5(path):  # version 7.3
        with h5py.File(path) as file:
            arrays: dict[str, Any] = {}
            file.visititems(lambda name, item: _keep(path, arrays, name, item))
            yield Arrays(path, _inside(path, arrays, table))
    else:
        try:
            variables = scipy.io.loadmat(path, simplify_cells=True)
        except Exception as error:  # a damaged file makes it raise almost anything
            raise damaged(path, error) from error
        named = {name: value for name, value in variables.items() if not name.startswith("__")}
        yield Arrays(path, _inside(path, dict(_flat(named)), table))


def _keep(path: Path, arrays: dict[str, Any], name: str, item: object) -> None:
    """Keep a dataset of a .mat file of version 7.3, unless it only stands for letters or nothing."""
    if isinstance(item, h5py.Dataset) and not name.startswith("#"):
        if item.size and item.dtype.kind in "iufb":
            check_storage(item, f"{path}: column {key(name)}")
        marked = item.attrs.get("MATLAB_class") == b"char" or "MATLAB_empty" in item.attrs
        arrays[name.replace("/", ".")] = np.empty(()) if marked else item


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value if isinstance(value, np.ndarray) else np.empty(())


def _inside(path: Path, arrays: Mapping[str, Any], table: str | int | None) -> Mapping[str, Any]:
    """Return what lies in a struct, without its name."""
    if table is None:
        return arrays
    inside = {k.removeprefix(f"{table}."): a for k, a in arrays.items() if k.startswith(f"{table}.")}
    if not inside:
        there = ", ".join(dict.fromkeys(name.rpartition(".")[0] for name in arrays if "." in name)) or "none"
        raise InputError(f"{path}: no table {table!r}, expected a struct; there are: {there}")
    return inside
