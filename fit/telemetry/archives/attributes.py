"""Attributes of HDF5 and netCDF that say what numbers mean: unit, missing samples, scale."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from fit.telemetry.archives.arrays import Series
from fit.telemetry.archives.table import Column, clean_unit
from fit.telemetry.validation import plain

_UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_MISSING = ("_FillValue", "missing_value")


def unit_of(attributes: Mapping[str, Any]) -> str | None:
    """Return the unit that attributes state; of "seconds since 2016-04-16", as netCDF has it, "seconds"."""
    stated = next((plain(attributes[name]) for name in _UNITS if name in attributes), None)
    return clean_unit(stated.partition(" since ")[0]) if isinstance(stated, str) else None


def decode(series: Series, attributes: Mapping[str, Any]) -> Series:
    """Return a column with the missing samples and the scale that its attributes state.

    Parameters
    ----------
    series : Series
        As it is stored.
    attributes : mapping of str to object
        By name; a mark of missing records has that of each field.
    """
    column = series.column
    if column.size is None or column.text:
        return series
    if str(plain(attributes.get("_Unsigned", "false"))).lower() != "false":
        reason = "unsigned integers stored as signed ones (attribute _Unsigned)"
        return Series(Column(None, column.unit, reason), source=series.source)
    stated = [np.atleast_1d(attributes[name]) for name in _MISSING if name in attributes]
    stated = [_of_field(values, series.field) for values in stated]
    marks = [mark for values in stated for mark in values if _is_representable(mark, series.dtype)]
    if marks:
        series = series.missing_at(np.asarray(marks).astype(series.dtype))
    scale, offset = (plain(attributes.get(name)) for name in ("scale_factor", "add_offset"))
    if isinstance(scale, int | float) or isinstance(offset, int | float):
        series = series.scaled(
            float(scale) if isinstance(scale, int | float) else 1.0,
            float(offset) if isinstance(offset, int | float) else 0.0,
        )
    return series


def _of_field(values: Any, field: str) -> Any:
    """Return what an attribute states of a field: its part of a record, else the attribute itself."""
    if values.dtype.names is None:
        return values
    return values[field] if field in values.dtype.names else ()


def _is_representable(mark: Any, kind: np.dtype[Any] | None) -> bool:
    """Return whether a mark of missing samples can be among numbers of a type."""
    if kind is None or not isinstance(mark, np.number) or kind.kind not in "iuf":
        return False
    with np.errstate(all="ignore"):
        return kind.kind == "f" or bool(mark.astype(kind) == mark)
