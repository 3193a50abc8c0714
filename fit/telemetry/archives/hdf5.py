"""HDF5 of any layout: of h5py, pandas, gwpy, lisainstrument, netCDF and MATLAB 7.3."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from fit.errors import InputError
from fit.telemetry.archives import dataframes, matlab73, netcdf, objects
from fit.telemetry.archives.arrays import Arrays, Series, select_table, series_of
from fit.telemetry.archives.attributes import decode, unit_of
from fit.telemetry.archives.table import Column, Table
from fit.telemetry.validation import plain, storage_fault

SUFFIXES = (".h5", ".hdf5", ".hdf", ".he5", ".nc", ".nc4")
_CACHE = 2**26  # bytes of unpacked chunks, so that rows of a matrix are not unpacked for each of its columns
_HIDDEN = ("#refs#", "#subsystem#")  # of MATLAB


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open an HDF5 file; `table` names a group, a set of records or a matrix."""
    if netcdf.is_netcdf(path):
        yield Arrays(path, "netCDF", select_table(path, netcdf.series_of_file(path), table))
        return
    if not h5py.is_hdf5(path):
        raise InputError(f"{path}: cannot be read as HDF5, expected a whole file of this format")
    with h5py.File(path, rdcc_nbytes=_CACHE) as file:
        yield Arrays(path, "HDF5", select_table(path, _series(path, file), table))


def _series(path: Path, file: h5py.File) -> dict[str, Series]:
    series: dict[str, Series] = {}
    frames: list[str] = []
    of_classes: dict[str, str] = {}

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        top = name.partition("/")[0]
        if top in _HIDDEN or any(name.startswith(f"{frame}/") for frame in frames):
            return
        kind = matlab73.class_of(item)
        if kind is not None:
            of_classes.setdefault(top, kind)
        elif isinstance(item, h5py.Group):
            dotted, reason = name.replace("/", "."), matlab73.reason_of(item)
            frame = dataframes.series_of(dotted, item)
            if reason:
                frame = {dotted: Series(Column(None, reason=reason), source=dotted)}
            if frame is not None:
                frames.append(name)
                series.update(frame)
        elif isinstance(item, h5py.Dataset):
            dotted = name.replace("/", ".")
            series.update(_of_dataset(f"/{name}" if dotted in series else dotted, item))

    def visit_link(name: str, link: object) -> None:
        if not isinstance(link, h5py.HardLink):
            dotted = name.replace("/", ".")
            series.setdefault(dotted, Series(Column(None, reason="a link"), source=dotted))

    file.visititems(visit)
    file.visititems_links(visit_link)
    if of_classes:
        series = {k: column for k, column in series.items() if k.partition(".")[0] not in of_classes}
        series |= objects.series_of_file(path, of_classes)
    return series


def _of_dataset(name: str, dataset: h5py.Dataset) -> dict[str, Series]:
    """Return the columns of a dataset."""
    matlab = plain(dataset.attrs.get("MATLAB_class"))
    if dataset.shape is None or "MATLAB_empty" in dataset.attrs or not dataset.size:
        return {name: Series(Column(None, reason="empty"), source=name)}
    if fault := storage_fault(dataset):
        return {name: Series(Column(None, reason=fault), source=name)}
    if matlab == "char":
        return {name: matlab73.letters(dataset, name)}
    if matlab is None and matlab73.is_member(dataset):
        struct, _, field = name.rpartition(".")
        return matlab73.members(dataset, struct, field)
    if matlab == "cell":
        return matlab73.cells(dataset, name)
    series = series_of(name, dataset, unit_of(dataset.attrs))
    return {column: decode(values, dataset.attrs) for column, values in series.items()}
