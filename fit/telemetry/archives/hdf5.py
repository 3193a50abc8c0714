"""HDF5 of any layout: of h5py, pandas, gwpy, lisainstrument, netCDF and MATLAB 7.3."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from fit.errors import InputError
from fit.telemetry.archives import matlab_hdf5, matlab_objects, netcdf, pandas_hdf5
from fit.telemetry.archives.arrays import LazyArray, select_table
from fit.telemetry.archives.table import Column, Table
from fit.telemetry.validation import plain, storage_fault

SUFFIXES = (".h5", ".hdf5", ".hdf", ".he5", ".nc", ".nc4")
_HIDDEN = ("#refs#", "#subsystem#")  # of MATLAB
#: What h5py and NumPy raise of types and attributes that they do not know.
_UNREADABLE = (TypeError, ValueError, KeyError, AttributeError)


@contextmanager
def open_table(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open an HDF5 file; `table` names a group, a set of records or a matrix."""
    if netcdf.is_netcdf(path):
        yield Table(path, "netCDF", select_table(path, netcdf.file_columns(path), table))
        return
    if not h5py.is_hdf5(path):
        raise InputError(f"{path}: cannot be read as HDF5, expected a whole file of this format")
    with h5py.File(path) as file:
        yield Table(path, "HDF5", select_table(path, _columns(path, file), table))


def _columns(path: Path, file: h5py.File) -> dict[str, Column]:
    columns: dict[str, Column] = {}
    frames: list[str] = []
    of_classes: dict[str, str] = {}

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        top, dotted = name.partition("/")[0], name.replace("/", ".")
        if top in _HIDDEN or any(name.startswith(f"{frame}/") for frame in frames):
            return
        try:
            read(name, top, item)
        except _UNREADABLE:  # one that no map names must not cost the others
            columns[dotted] = Column(reason="of a type that is not read", source=dotted)

    def read(name: str, top: str, item: h5py.Dataset | h5py.Group) -> None:
        kind = matlab_hdf5.class_of(item)
        if kind is not None:
            of_classes.setdefault(top, kind)
        elif isinstance(item, h5py.Group):
            dotted, reason = name.replace("/", "."), matlab_hdf5.reason_of(item)
            frame = pandas_hdf5.frame_columns(dotted, item)
            if reason:
                frame = {dotted: Column(reason=reason, source=dotted)}
            if frame is not None:
                frames.append(name)
                columns.update(frame)
        elif isinstance(item, h5py.Dataset):
            dotted = name.replace("/", ".")
            columns.update(_dataset_columns(f"/{name}" if dotted in columns else dotted, item))

    def visit_link(name: str, link: object) -> None:
        if not isinstance(link, h5py.HardLink):
            dotted = name.replace("/", ".")
            columns.setdefault(dotted, Column(reason="a link", source=dotted))

    file.visititems(visit)
    file.visititems_links(visit_link)
    if of_classes:
        columns = {k: column for k, column in columns.items() if k.partition(".")[0] not in of_classes}
        columns |= matlab_objects.object_columns(path, of_classes)
    return columns


def _dataset_columns(name: str, dataset: h5py.Dataset) -> dict[str, Column]:
    """Return the columns of a dataset."""
    matlab = plain(dataset.attrs.get("MATLAB_class"))
    if dataset.shape is None or "MATLAB_empty" in dataset.attrs or not dataset.size:
        return {name: Column(reason="empty", source=name)}
    if fault := storage_fault(dataset):
        return {name: Column(reason=fault, source=name)}
    if matlab == "char":
        return {name: matlab_hdf5.letters(dataset, name)}
    if matlab is None and matlab_hdf5.is_member(dataset):
        struct, _, field = name.rpartition(".")
        return matlab_hdf5.members(dataset, struct, field)
    if matlab == "cell":
        return matlab_hdf5.cells(dataset, name)
    return netcdf.decoded_columns(name, LazyArray.wrap(dataset), dataset.attrs)
