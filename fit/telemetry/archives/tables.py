"""Binary tables: FITS by astropy, HDF5 of any layout by h5py, MATLAB's .mat by mat-io."""

import gzip
import io
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.telemetry.archives.columns import Column, Table, clean_unit, columns_of, unreadable
from fit.telemetry.validation import readable_attributes, storage_fault

FITS_SUFFIXES = (".fits", ".fit", ".fts", ".fits.gz", ".fit.gz", ".fts.gz")
HDF5_SUFFIXES = (".h5", ".hdf5", ".hdf", ".he5", ".nc", ".nc4")
_UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_MISSING = ("_FillValue", "missing_value")
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")


@contextmanager
def open_hdf5(path: Path) -> Iterator[Table]:
    """Open an HDF5 file: all datasets with real numbers or texts, those of netCDF decoded."""
    with h5py.File(path) as file:
        columns: dict[str, Column] = {}

        def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
            if isinstance(item, h5py.Dataset):
                dotted = name.replace("/", ".")
                columns.update(_dataset_columns(f"/{name}" if dotted in columns else dotted, item))

        file.visititems(visit)  # follows no link
        yield Table(path, columns)


def _dataset_columns(name: str, dataset: h5py.Dataset) -> dict[str, Column]:
    """Return the columns of a dataset with unit, epoch, missing samples and scale of its attributes."""
    try:
        kind, attributes = dataset.dtype, readable_attributes(dataset.attrs)
    except TypeError:  # NumPy lacks it, such as H5T_TIME
        return {name: unreadable("of a type that is not read")}
    if dataset.shape is None or not dataset.size:
        return {name: unreadable("empty")}
    if fault := storage_fault(dataset) or _packing_fault(kind, attributes):
        return {name: unreadable(fault)}
    stated = next((text for key in _UNITS if isinstance(text := attributes.get(key), str)), "")
    unit, _, epoch = stated.partition(" since ")  # "seconds since 2016-04-16", as netCDF has it
    columns = columns_of(name, dataset, cache(partial(_decoded, dataset, attributes)), clean_unit(unit))
    return {k: Column(c.read, c.unit, epoch.strip()) for k, c in columns.items()}


def _packing_fault(kind: np.dtype[Any], attributes: Mapping[str, object]) -> str:
    """Say which attributes make something of the values that is not read; empty if none does."""
    if str(attributes.get("_Unsigned", "false")).lower() != "false":
        return "unsigned integers stored as signed ones (attribute _Unsigned)"
    if kind.names and any(name in attributes for name in (*_MISSING, "scale_factor", "add_offset")):
        return "records with an attribute for missing samples or a scale"
    calendar = attributes.get("calendar", "standard")
    return "" if calendar in _CALENDARS else f"times of calendar {calendar!r}"


def _decoded(dataset: h5py.Dataset, attributes: Mapping[str, object]) -> NDArray[Any]:
    values: NDArray[Any] = np.asarray(dataset[()])
    if values.dtype.kind not in "iuf":
        return values
    missing = np.zeros(values.shape, bool)
    for name in _MISSING:
        marker = np.asarray(attributes.get(name, np.nan))
        missing |= np.isin(values, marker.astype(values.dtype) if values.dtype.kind == "f" else marker)
    scale, shift = (np.asarray(attributes.get(k, n)) for k, n in (("scale_factor", 1.0), ("add_offset", 0.0)))
    return np.where(missing, np.nan, values.astype(np.float64) * scale + shift)


@contextmanager
def open_fits(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open a FITS file; `table` is the name or the number of an extension, None the first table."""
    from astropy.io import fits  # takes its time

    packed = path.suffix.lower() == ".gz"  # read to its end, where the checksum stands
    source = io.BytesIO(gzip.decompress(path.read_bytes())) if packed else path
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a file cut short is only warned about
        warnings.simplefilter("ignore", fits.verify.VerifyWarning)
        with fits.open(source) as hdus:
            tables = {i: hdu for i, hdu in enumerate(hdus) if isinstance(hdu, fits.BinTableHDU)}
            name = table.casefold() if isinstance(table, str) else table
            chosen = [hdu for i, hdu in tables.items() if name in (None, i, hdu.name.casefold())]
            if not chosen:
                available = ", ".join(hdu.name or str(i) for i, hdu in tables.items()) or "none"
                requested = "table" if table is None else f"table {table!r}"
                raise InputError(f"{path}: no {requested}, expected a binary table; there are: {available}")
            columns: dict[str, Column] = {}
            for column in chosen[0].columns:
                values = _fits_values(chosen[0], column)
                columns |= columns_of(column.name, values, partial(np.asarray, values), column.unit)
    yield Table(path, columns, has_order=len(columns) == len(chosen[0].columns))


def _fits_values(hdu: Any, column: Any) -> NDArray[Any]:
    """Return a column with NaN for missing numbers."""
    values: NDArray[Any] = np.asarray(hdu.data[column.name])
    stored = np.asarray(hdu.data.view(np.ndarray)[column.name])  # before TSCAL, TZERO and TNULL
    if column.null is not None and stored.dtype.kind in "iu":
        return np.where(stored == column.null, np.nan, values)
    return values
