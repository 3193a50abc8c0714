"""Files of series that are no telemetry of one run, such as those of a constellation of three spacecraft.

They are laid out as telemetry: a dataset ``time`` (s, uniform), every series a dataset on it with its unit,
and root attributes. The schema and the series that must be there are those of the caller.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.files import key
from fit.telemetry.lazy_channels import open_file
from fit.telemetry.validation import checked_dataset, read_channel, read_time, readable_attributes

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SeriesFile:
    """The content of a file of series.

    Attributes
    ----------
    path : Path
        The file.
    attributes : dict of str to object
        Of the root.
    fs : float
        Sample rate [Hz].
    start : float
        Time of the first sample [s].
    series : dict of str to ndarray, each of shape (N,)
        In the units that were asked for.
    truth : dict of str to float
        Attributes of the group ``/truth``; empty without it.
    """

    path: Path
    attributes: dict[str, object]
    fs: float
    start: float
    series: dict[str, Array]
    truth: dict[str, float]


def read_series(
    path: Path, schema: str, units: Mapping[str, str], *, optional: Collection[str] = (), gaps: bool = False
) -> SeriesFile:
    """Read a file of series.

    Parameters
    ----------
    path : Path
        The file.
    schema : str
        What its root attribute ``schema`` must be.
    units : mapping of str to str
        The unit of every series.
    optional : collection of str
        Those that need not be there.
    gaps : bool
        Let missing samples pass, as NaN.

    Raises
    ------
    InputError
        If the file, an attribute or a series is missing or wrong; the message names it.
    """
    with open_file(path, schema) as file:
        attributes = readable_attributes(file.attrs)
        if attributes.get("schema") != schema:
            stated = shown(attributes.get("schema"))
            raise InputError(f"{path}: attribute schema: {stated}, expected {schema!r}")
        rate = "fs" if "fs" in attributes else "dt"  # of telemetry, and of lisainstrument
        value = attributes.get(rate)
        if not isinstance(value, int | float) or not (math.isfinite(value) and value > 0):
            raise InputError(f"{path}: attribute {rate}: {shown(value)}, expected a positive number")
        fs = float(value) if rate == "fs" else 1 / value
        time, series = read_time(file, path, fs), {}
        for name, unit in units.items():
            if name in optional and name not in file:
                continue
            checked_dataset(file, path, name, unit, time.size)
            series[name] = read_channel(file, path, name, slice(0, time.size), fs)
            if (missing := np.isnan(series[name])).any() and not gaps:
                place = f"{path}: channel {key(name)}"
                raise InputError(f"{place}: sample {int(np.argmax(missing))} is missing, expected all")
        truth = readable_attributes(file["truth"].attrs) if isinstance(file.get("truth"), h5py.Group) else {}
    numbers = {name: float(x) for name, x in truth.items() if isinstance(x, int | float) and math.isfinite(x)}
    return SeriesFile(path, attributes, fs, float(time[0]), series, numbers)
