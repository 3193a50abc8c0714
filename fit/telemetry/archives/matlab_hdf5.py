"""What MATLAB stores in HDF5 in a way of its own (.mat files of version 7.3): letters, cells and objects."""

from collections.abc import Callable
from functools import partial
from typing import Any

import h5py

from fit.telemetry.archives.arrays import LazyArray, columns_of
from fit.telemetry.archives.table import Column
from fit.telemetry.validation import plain, storage_fault

_OBJECT = 3  # of the attribute MATLAB_object_decode
_MOST_CELLS = 100  # of numbers


def class_of(item: h5py.Dataset | h5py.Group) -> str | None:
    """Return the class of an object, or of the first one in a cell array; None for what is none."""
    if item.attrs.get("MATLAB_object_decode") == _OBJECT:
        return str(plain(item.attrs.get("MATLAB_class")))
    if isinstance(item, h5py.Dataset) and plain(item.attrs.get("MATLAB_class")) == "cell":
        return next((class_of(item.file[reference]) for reference in _references(item)[:1]), None)
    return None


def letters(dataset: h5py.Dataset, name: str) -> Column:
    """Return the rows of a matrix of letters, which MATLAB stores column by column."""
    if dataset.ndim != 2 or dataset.shape[1] < 2 or dataset.dtype.kind != "u":
        return Column(reason="text", source=name)

    def read() -> list[str]:
        return ["".join(map(chr, row)) for row in dataset[()].T.tolist()]

    return Column(dataset.shape[1], None, "text", True, read, name)


def reason_of(group: h5py.Group) -> str:
    """Return what a group is that holds one value, and no values by name; empty for others."""
    if "MATLAB_sparse" in group.attrs:
        return "a sparse matrix"
    return "a function" if plain(group.attrs.get("MATLAB_class")) == "function_handle" else ""


def is_member(dataset: h5py.Dataset) -> bool:
    """Return whether a dataset refers to the values of a field in an array of structs."""
    return dataset.dtype == h5py.ref_dtype and plain(dataset.parent.attrs.get("MATLAB_class")) == "struct"


def members(dataset: h5py.Dataset, struct: str, field: str) -> dict[str, Column]:
    """Return the columns ``struct[k].field`` of an array of structs."""
    return _numbers(dataset, lambda k: f"{struct}[{k}].{field}")


def cells(dataset: h5py.Dataset, name: str) -> dict[str, Column]:
    """Return a cell array: one column of texts, or ``name[k]`` for each cell with numbers."""
    references = _references(dataset)
    if references and all(_is_text(dataset.file[reference]) for reference in references[:_MOST_CELLS]):
        read = partial(_texts, dataset.file, references)
        return {name: Column(len(references), None, "text", True, read, name)}
    columns = _numbers(dataset, lambda k: f"{name}[{k}]")
    return columns or {name: Column(reason="a cell array", source=name)}


def _numbers(dataset: h5py.Dataset, name: Callable[[int], str]) -> dict[str, Column]:
    """Return the columns of numbers that a dataset refers to, the k-th by the name of k."""
    columns: dict[str, Column] = {}
    references = _references(dataset)
    for k, reference in enumerate(references if len(references) <= _MOST_CELLS else [], 1):
        cell = dataset.file[reference]
        if _are_numbers(cell):
            columns |= columns_of(name(k), LazyArray.wrap(cell))
    return columns


def _references(dataset: h5py.Dataset) -> list[h5py.Reference]:
    """Return where the content of the cells is in the file."""
    if dataset.dtype != h5py.ref_dtype or "MATLAB_empty" in dataset.attrs:
        return []
    return [reference for reference in dataset[()].ravel() if reference]


def _is_text(cell: Any) -> bool:
    return isinstance(cell, h5py.Dataset) and plain(cell.attrs.get("MATLAB_class")) == "char"


def _are_numbers(cell: Any) -> bool:
    if not isinstance(cell, h5py.Dataset) or not cell.size or "MATLAB_empty" in cell.attrs or _is_text(cell):
        return False
    return not storage_fault(cell)


def _texts(file: h5py.File, references: list[h5py.Reference]) -> list[str]:
    texts = []
    for cell in map(file.__getitem__, references):
        empty = not _is_text(cell) or "MATLAB_empty" in cell.attrs
        texts.append("" if empty else "".join(map(chr, cell[()].T.ravel().tolist())))
    return texts
