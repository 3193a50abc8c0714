"""netCDF-3, the format of .nc files before HDF5, and the attributes of netCDF: unit, missing, scale."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from fit.telemetry.archives.arrays import LazyArray, columns_of
from fit.telemetry.archives.table import Column, clean_unit, read_error
from fit.telemetry.validation import plain

_MAGIC = b"CDF"
_UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_MISSING = ("_FillValue", "missing_value")
_CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
_ATTRIBUTES = (*_MISSING, "units", "calendar", "scale_factor", "add_offset", "_Unsigned")


def is_netcdf(path: Path) -> bool:
    """Return whether a file is netCDF-3."""
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def file_columns(path: Path) -> dict[str, Column]:
    """Return the variables of a netCDF-3 file, which is read whole."""
    columns: dict[str, Column] = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with scipy.io.netcdf_file(path, mmap=False) as file:
                for name, variable in file.variables.items():
                    attributes = {k: getattr(variable, k) for k in _ATTRIBUTES if hasattr(variable, k)}
                    columns |= decoded_columns(name, LazyArray.wrap(np.array(variable.data)), attributes)
    except Exception as error:  # a damaged file makes it raise almost anything
        raise read_error(path, error, "netCDF") from error
    return columns


def decoded_columns(name: str, array: LazyArray, attributes: Mapping[str, Any]) -> dict[str, Column]:
    """Return the columns of an array with the unit, missing samples and scale that its attributes state."""
    stated = next((plain(attributes[key]) for key in _UNITS if key in attributes), None)
    # "seconds since 2016-04-16", as netCDF has it
    name_of_unit, _, epoch = stated.partition(" since ") if isinstance(stated, str) else ("", "", "")
    unit = clean_unit(name_of_unit)
    calendar = str(plain(attributes.get("calendar", "standard")))
    if epoch and calendar not in _CALENDARS:
        return {name: Column(None, unit, f"times of calendar {calendar!r}", source=name)}
    if array.dtype.names and array.dtype.names != ("real", "imag"):
        columns: dict[str, Column] = {}
        for field in array.dtype.names:
            part = columns_of(f"{name}.{field}" if name else field, array.field(field), unit)
            kind = array.dtype[field].base
            columns |= {k: _decode(column, kind, attributes, field) for k, column in part.items()}
    else:
        part = columns_of(name, array, unit)
        columns = {k: _decode(column, array.dtype, attributes) for k, column in part.items()}
    return {k: replace(column, source=name, epoch=epoch.strip()) for k, column in columns.items()}


def _decode(column: Column, kind: np.dtype[Any], attributes: Mapping[str, Any], field: str = "") -> Column:
    """Return a column of numbers with its scale, NaN for missing samples; marks may be records."""
    read = column.read
    if column.size is None or column.is_text or read is None:
        return column
    if str(plain(attributes.get("_Unsigned", "false"))).lower() != "false":
        return Column(None, column.unit, "unsigned integers stored as signed ones (attribute _Unsigned)")
    stated = [np.atleast_1d(attributes[name]) for name in _MISSING if name in attributes]
    stated = [_field_of(values, field) for values in stated]
    marks = [mark for values in stated for mark in values if _is_representable(mark, kind)]
    scale, offset = (plain(attributes.get(name)) for name in ("scale_factor", "add_offset"))
    factor = float(scale) if isinstance(scale, int | float) else 1.0
    shift = float(offset) if isinstance(offset, int | float) else 0.0

    def decoded() -> Any:
        values = np.asarray(read())
        missing = np.isin(values, np.asarray(marks).astype(kind)) if marks else False
        return np.where(missing, np.nan, factor * values.astype(np.float64) + shift)

    return replace(column, read=decoded)


def _field_of(values: Any, field: str) -> Any:
    """Return what an attribute states of a field: its part of a record, else the attribute itself."""
    if values.dtype.names is None:
        return values
    return values[field] if field in values.dtype.names else ()


def _is_representable(mark: Any, kind: np.dtype[Any]) -> bool:
    """Return whether a mark of missing samples can be among numbers of a type."""
    if not isinstance(mark, np.number) or kind.kind not in "iuf":
        return False
    with np.errstate(all="ignore"):
        return kind.kind == "f" or bool(mark.astype(kind) == mark)
