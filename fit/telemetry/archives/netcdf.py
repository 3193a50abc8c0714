"""netCDF-3, the format of .nc files before HDF5."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from fit.telemetry.archives.arrays import Series, series_of
from fit.telemetry.archives.attributes import decode, unit_of
from fit.telemetry.archives.table import read_error

_MAGIC = b"CDF"
_ATTRIBUTES = ("units", "_FillValue", "missing_value", "scale_factor", "add_offset", "_Unsigned")


def is_netcdf(path: Path) -> bool:
    """Return whether a file is netCDF-3."""
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def series_of_file(path: Path) -> dict[str, Series]:
    """Return the variables of a netCDF-3 file, which is read whole."""
    series: dict[str, Series] = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with scipy.io.netcdf_file(path, mmap=False) as file:
                for name, variable in file.variables.items():
                    series |= _series(name, variable)
    except Exception as error:  # a damaged file makes it raise almost anything
        raise read_error(path, error, "netCDF") from error
    return series


def _series(name: str, variable: Any) -> dict[str, Series]:
    values = np.array(variable.data)
    attributes = {key: getattr(variable, key) for key in _ATTRIBUTES if hasattr(variable, key)}
    columns = series_of(name, values, unit_of(attributes))
    return {column: decode(values, attributes) for column, values in columns.items()}
