"""Checks of a telemetry file against the contract: how its datasets are stored, time axis, units, samples.

Every function raises `fit.errors.InputError`; its message names the file, the place and what was expected.
"""

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.files import key
from fit.telemetry.contract import CHANNELS, required
from fit.telemetry.time_axis import check_time
from fit.units import same_unit

Array = NDArray[np.float64]

MAX_SAMPLES = 2**28  # 310 days at 10 Hz; a file that declares more is damaged
LARGEST = 1e6  # in SI, of any channel; squares and products of such values keep their digits
MAX_MISSING = 0.01  # share of the samples that may be missing in the channels a calibration needs
MAX_GAP = 600.0  # s
#: Attributes that make something else of values, and with which value they do not.
_PACKING: Mapping[str, object] = {"scale_factor": 1, "add_offset": 0, "_Unsigned": "false"}
_MISSING = ("_FillValue", "missing_value")
#: What archives write for a missing sample, signs aside: nines, and the ends of integers.
_USUAL = (*(10.0**n - 1 for n in range(3, 10)), 999.9, 9999.9, 2.0**15, 2.0**15 - 1, 2.0**31, 2.0**31 - 1)
_HUGE = 1e10  # in any unit of an archive; default fills of netCDF and others are beyond
_DOUBLE = 1e-15  # relative: rounding by a scale that the archive states
_MARKER_RATIO, _NUMBER_RATIO = 5.0, 100.0  # times the largest other sample: of a usual marker, of any number
_READ_OUTS = ("o_", "grs_")  # channels with noise in every sample
_SET_POINTS = "guidance_"  # channels that stay at the numbers that an operator chooses


def plain(value: object) -> object:
    """Return an attribute as str or scalar where it is one, be it bytes, NumPy scalar or 1-element array."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(())[()]
    if isinstance(value, bytes):
        try:
            return value.decode()
        except UnicodeDecodeError:
            return value.decode("latin-1")
    return value.item() if isinstance(value, np.generic) else value


def readable_attributes(attributes: h5py.AttributeManager) -> dict[str, object]:
    """Return attributes as `plain` has them, without those that NumPy lacks, such as H5T_TIME."""
    values: dict[str, object] = {}
    for name in attributes:
        with suppress(TypeError, UnicodeError):
            values[name] = plain(attributes[name])
    return values


def checked_dataset(
    file: h5py.File, path: Path, name: str, unit: str | None, size: int | None = None
) -> h5py.Dataset:
    """Return a dataset that is a row of `size` numbers in `unit`, stored in this file as they are.

    Raises
    ------
    InputError
        If there is none, or it is none such; of a unit None anything passes, of a size None any.
    """
    place = f"{path}: {name}" if name == "time" else f"{path}: channel {key(name)}"
    link = file.get(name, getlink=True)
    if link is not None and not isinstance(link, h5py.HardLink):
        raise InputError(f"{place}: a link, expected the dataset itself")
    dataset = None if link is None else file[name]
    if not isinstance(dataset, h5py.Dataset):
        raise InputError(f"{place}: missing, expected it{f' in {unit}' if unit else ''}")
    attributes = readable_attributes(dataset.attrs)
    stated = attributes.get("units", "s" if name == "time" else "")
    if unit is not None and not (isinstance(stated, str) and same_unit(stated, unit)):
        raise InputError(
            f"{place}: {f'units {shown(stated)}' if stated else 'without units'}, expected {unit!r}"
        )
    if dataset.ndim != 1 or dataset.dtype.kind not in "iufb":
        raise InputError(f"{place}: {dataset.dtype} of shape {dataset.shape}, expected a row of float64")
    if not (size or 2) <= dataset.shape[0] <= (size or MAX_SAMPLES):
        expected = f"the {size} of time" if size else f"2 to {MAX_SAMPLES}"
        raise InputError(f"{place}: {dataset.shape[0]} samples, expected {expected}")
    if fault := storage_fault(dataset):
        raise InputError(f"{place}: {fault}, expected its {dataset.size} values in this file")
    for attribute, neutral in _PACKING.items():
        value = attributes.get(attribute, neutral)
        if isinstance(value, np.ndarray) or value != neutral:  # xarray honours them, h5py does not
            raise InputError(
                f"{place}: attribute {attribute}: {shown(value)}, expected the values themselves"
            )
    return dataset


def read_time(file: h5py.File, path: Path, fs: float) -> Array:
    """Return the time axis [s], checked to be uniform with steps of 1/fs."""
    dataset = checked_dataset(file, path, "time", "s")
    return check_time(f"{path}: time", np.asarray(dataset[()], dtype=np.float64), fs)


def channel_units(file: h5py.File, path: Path, size: int) -> dict[str, str]:
    """Return the channels on a time axis of `size` samples and their units as written.

    What the contract knows is checked, but for the values.
    """
    needed = required(file)

    def is_channel(name: str) -> bool:
        if not isinstance(file.get(name, getlink=True), h5py.HardLink):
            return name in CHANNELS
        dataset = file[name]
        return isinstance(dataset, h5py.Dataset) and (name in CHANNELS or _is_channel(dataset))

    extras = [name for name in file if isinstance(name, str) and name not in {"time", *needed}]  # or bytes
    units: dict[str, str] = {}
    for name in (*needed, *filter(is_channel, extras)):
        expected = CHANNELS[name].unit or None if name in CHANNELS else None
        dataset = checked_dataset(file, path, name, expected, size)
        units[name] = str(readable_attributes(dataset.attrs).get("units", ""))
    return units


def channel_attribute(file: h5py.File, channels: Iterable[str], name: str) -> dict[str, object]:
    """Return an attribute of channels, of those that have it."""
    attributes = {channel: readable_attributes(file[channel].attrs) for channel in channels}
    return {channel: stated[name] for channel, stated in attributes.items() if name in stated}


def read_channel(file: h5py.File, path: Path, name: str, part: slice, fs: float) -> Array:
    """Return a part of a channel; a missing sample is NaN, an infinite one is refused."""
    dataset, place, start = file[name], f"{path}: channel {key(name)}", part.start or 0
    values = np.asarray(dataset[part], dtype=np.float64)
    for attribute, marker in readable_attributes(dataset.attrs).items():
        if attribute in _MISSING and not (isinstance(marker, float) and math.isnan(marker)):
            hit = np.isin(values, marker) if isinstance(marker, float | int) else np.ones(values.size, bool)
            if hit.any():
                raise InputError(
                    f"{place}: attribute {attribute}: {shown(marker)} stands for missing samples, such as "
                    f"number {start + int(np.argmax(hit))}, expected NaN"
                )
    check_values(place, values, fs, start, known=name in CHANNELS)
    return values


def check_values(place: str, values: Array, fs: float, start: int = 0, *, known: bool = True) -> None:
    """Refuse an infinite value, or in a known channel one beyond `LARGEST`; the first has number `start`."""
    low, high = (-LARGEST, LARGEST) if known else (-np.finfo(float).max, np.finfo(float).max)
    if low <= values.min(initial=0.0) and values.max(initial=0.0) <= high:  # false where samples are missing
        return
    if (out_of_range := (values < low) | (values > high)).any():
        n = int(np.argmax(out_of_range))
        value = f"{values[n]:.7g} at sample {start + n} (t = {(start + n) / fs:.10g} s)"
        limit = f"at most {LARGEST:g}" if known else "finite"
        raise InputError(f"{place}: {value}, expected values that are {limit}, and NaN where one is missing")


def check_markers(place: str, channel: str, values: Array, cure: str = "NaN for each") -> None:
    """Refuse a channel in which a number seems to mark missing samples: the largest, far from all others.

    An instrument does not give the same number to the last digit again and again, far outside of all others.

    Parameters
    ----------
    place, channel : str
        File and channel for the message, and the name of the channel.
    values : ndarray, shape (N,)
        Its samples.
    cure : str
        What is expected, with ``{marker}`` for the number.
    """
    size = np.where(np.isfinite(values), np.abs(values), 0.0)
    largest = size.max(initial=0.0)
    extreme = size == largest
    count, rest = int(extreme.sum()), float(size[~extreme].max(initial=0.0))
    if channel not in CHANNELS or not 2 <= count < size.size or largest <= _MARKER_RATIO * rest:
        return
    is_usual = largest >= _HUGE or (
        not channel.startswith(_SET_POINTS) and bool(_equal(np.array(_USUAL), largest).any())
    )
    is_rare = channel.startswith(_READ_OUTS) and count < size.size / 2
    if is_usual or (is_rare and largest > _NUMBER_RATIO * rest > 0.0):
        n = int(np.argmax(extreme))
        value, single = float(values[n]), np.float32(values[n])
        marker = str(single) if float(single) == value else repr(value)
        raise InputError(
            f"{place}: {value:.7g} at sample {n}, {count} times in all, seems to mark missing samples, "
            f"expected {cure.format(marker=marker)}"
        )


def replace_markers(values: Array, missing: Iterable[float]) -> Array:
    """Return values of an archive, NaN where one is a marker in double or single precision."""
    for marker in missing:
        values = np.where(_equal(values, marker), np.nan, values)
    return values


def _equal(values: Array, marker: float) -> NDArray[np.bool_]:
    """Return which values are a number, or what single precision makes of it."""
    with np.errstate(over="ignore"):
        single = float(np.float32(marker))
    close = np.isclose(values, marker, rtol=_DOUBLE, atol=0.0)
    return np.asarray(close | ((values == single) & np.isfinite(single)))


def check_missing(missing: Mapping[str, NDArray[np.bool_]], fs: float) -> None:
    """Refuse more missing samples than may be masked in what a calibration needs, given by place."""
    if not any(flags.any() for flags in missing.values()):
        return
    together = np.any(list(missing.values()), axis=0)
    present = np.flatnonzero(~together)
    longest = int(np.diff(present, prepend=-1, append=together.size).max()) - 1
    share = float(together.mean())
    if share <= MAX_MISSING and longest <= MAX_GAP * fs:
        return
    worst = max(missing, key=lambda place: int(missing[place].sum()))
    first_missing = int(np.argmax(missing[worst]))
    raise InputError(
        f"{worst}: nan from sample {first_missing} (t = {first_missing / fs:.10g} s) on, "
        f"{100 * share:.4g} % of the samples are missing with gaps of up to {longest / fs:.6g} s, "
        f"expected at most {100 * MAX_MISSING:g} % and {MAX_GAP:g} s"
    )


def _is_channel(dataset: h5py.Dataset) -> bool:
    """Return whether an unknown dataset lies on the time axis: 1-D, real numbers, on no other dimension."""
    with suppress(TypeError):  # NumPy lacks the type, such as H5T_TIME
        if dataset.dtype.kind in "iufb" and dataset.ndim == 1 and not dataset.is_scale:
            axes = [scale.name for scale in dataset.dims[0].values()]
            return not axes or "/time" in axes
    return False


def storage_fault(dataset: h5py.Dataset) -> str:
    """Say what is wrong with how a dataset is stored, or nothing: what is not there reads as zeros."""
    if dataset.is_virtual or dataset.external:
        return "kept in other files"
    size, stored_bytes = dataset.size or 0, dataset.id.get_storage_size()
    if stored_bytes > dataset.file.id.get_filesize():
        return f"declares {stored_bytes} bytes, more than the file has"
    if dataset.chunks is None:
        written = stored_bytes // dataset.dtype.itemsize
    else:
        written = dataset.id.get_num_chunks() * math.prod(dataset.chunks)
    if written < size:
        return f"declared but {f'only {written} values of {size}' if written else 'never'} written"
    return ""
