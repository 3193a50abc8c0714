"""Checks of a telemetry file against the contract: how its datasets are stored, time axis, units, samples.

Every function raises `fit.errors.InputError`; its message names the file, the place and what was expected.
"""

import errno
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, shown
from fit.files import key
from fit.telemetry.contract import CHANNELS, expected_unit, required
from fit.telemetry.time_axis import check_time
from fit.units import same_unit

Array = NDArray[np.float64]

MAX_SAMPLES = 2**28  # 310 days at 10 Hz; a file that declares more is damaged
LARGEST = 1e6  # in SI, of any channel; squares and products of such values keep their digits
MAX_MISSING = 0.01  # share of the samples that may be missing in the channels a calibration needs
MAX_GAP = 600.0  # s
MAX_CHUNK = 2**24  # values that are unpacked at a time
#: What may stand between a chunk and the file: these are safe with whatever they are given.
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF}

#: Attributes that make something else of values, and with which value they do not.
_PACKING: Mapping[str, object] = {"scale_factor": 1, "add_offset": 0, "_Unsigned": "false"}
_MISSING = ("_FillValue", "missing_value")
#: What archives write for a missing sample, signs aside: nines, and the ends of integers.
_USUAL = (
    *(10.0**n - 1 for n in range(3, 10)),
    999.9,
    9999.9,
    *(2.0**n - k for n in (15, 31) for k in (0, 1)),
)
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


def is_locked(error: Exception) -> bool:
    """Return whether a file could not be opened for a lock, its content unseen."""
    return isinstance(error, OSError) and error.errno in (errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOLCK)


#: What to say of such a file.
LOCKED = "locked by another process (or the file system has no locks: HDF5_USE_FILE_LOCKING=FALSE)"


def readable_attributes(attributes: h5py.AttributeManager) -> dict[str, object]:
    """Return attributes as `plain` has them, without those of a type that NumPy lacks, such as H5T_TIME."""
    values: dict[str, object] = {}
    for name in attributes:
        with suppress(TypeError):
            values[name] = plain(attributes[name])
    return values


def attribute(item: h5py.Dataset, name: str, default: object = None) -> object:
    """Return an attribute as `plain` has it, the default if there is none of a type that NumPy has."""
    with suppress(TypeError):
        return plain(item.attrs.get(name, default))
    return default


def read_time(file: h5py.File, path: Path, fs: float) -> Array:
    """Return the time axis [s], checked to be uniform with steps of 1/fs."""
    dataset = _local_dataset(file, path, "time", "time")
    if dataset is None:
        raise InputError(f"{path}: time: missing, expected the seconds since t0")
    units = attribute(dataset, "units", "s")
    if not isinstance(units, str) or units not in ("s", "sec", "second", "seconds"):
        raise InputError(f"{path}: time: units {shown(units)}, expected 's'")
    _check_size(dataset, path, "time", None)
    _check_plain(dataset, f"{path}: time")
    return check_time(f"{path}: time", np.asarray(dataset[()], dtype=np.float64), fs)


def channel_units(file: h5py.File, path: Path, size: int) -> dict[str, str]:
    """Return the channels on a time axis of `size` samples and their units as written.

    What the contract knows is checked, but for the values.
    """
    units: dict[str, str] = {}
    needed = required(file)
    for name in (
        *needed,
        *(optional for optional in file if optional not in {"time", *needed} and isinstance(optional, str)),
    ):
        expected = expected_unit(name)
        place = f"channel {key(name)}"
        if expected is None and not isinstance(file.get(name, getlink=True), h5py.HardLink):
            continue
        dataset = _local_dataset(file, path, place, name)
        if dataset is None:
            if name in needed:
                raise InputError(f"{path}: channel {name}: missing, expected for a calibration")
            continue
        if expected is None and not _is_channel(dataset):
            continue
        unit = attribute(dataset, "units", "")
        if expected is not None and not (isinstance(unit, str) and same_unit(unit, expected)):
            stated = f"units {shown(unit)}" if "units" in dataset.attrs else "without units"
            raise InputError(f"{path}: {place}: {stated}, expected {expected!r}")
        _check_size(dataset, path, place, size)
        _check_plain(dataset, f"{path}: {place}")
        units[name] = str(unit)
    return units


def channel_names(file: h5py.File, channels: Iterable[str]) -> dict[str, str]:
    """Return what the file says channels are, for those of which it does."""
    names = {name: attribute(file[name], "long_name") for name in channels}
    return {name: text for name, text in names.items() if isinstance(text, str)}


def complete_channels(file: h5py.File, channels: Iterable[str]) -> set[str]:
    """Return the channels that state that no number marks missing samples: their missing_value is NaN."""
    stated = {name: attribute(file[name], "missing_value") for name in channels}
    return {name for name, value in stated.items() if isinstance(value, float) and math.isnan(value)}


def read_channel(file: h5py.File, path: Path, name: str, part: slice, fs: float) -> Array:
    """Return a part of a channel; a missing sample is NaN, an infinite one is refused."""
    dataset, place, start = file[name], f"{path}: channel {key(name)}", part.start or 0
    values = np.asarray(dataset[part], dtype=np.float64)
    _check_missing_value(dataset, values, place, start)
    check_values(place, values, fs, start, known=expected_unit(name) is not None)
    return values


def check_values(place: str, values: Array, fs: float, start: int = 0, *, known: bool = True) -> None:
    """Refuse an infinite value, or in a known channel one beyond `LARGEST`; the first has number `start`."""
    low, high = (-LARGEST, LARGEST) if known else (-np.finfo(float).max, np.finfo(float).max)
    if low <= values.min(initial=0.0) and values.max(initial=0.0) <= high:  # false where samples are missing
        return
    if (out_of_range := (values < low) | (values > high)).any():
        n = int(np.argmax(out_of_range))
        place_and_value = f"{place}: {values[n]:.7g} at sample {start + n} (t = {(start + n) / fs:.10g} s)"
        if not np.isfinite(values[n]):
            raise InputError(f"{place_and_value}, expected a finite value")
        if np.count_nonzero(values == values[n]) > 1:
            raise InputError(
                f"{place_and_value}, repeated later, seems to mark missing samples, expected NaN for each"
            )
        raise InputError(f"{place_and_value}, expected a value of at most {LARGEST:g}")


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
    try:
        kind = dataset.dtype.kind
    except TypeError:  # NumPy lacks it, such as H5T_TIME
        return False
    if dataset.ndim != 1 or kind not in "iufb" or dataset.is_scale:
        return False
    axes = [scale.name for scale in dataset.dims[0].values()]
    return not axes or "/time" in axes


def _check_size(dataset: h5py.Dataset, path: Path, place: str, size: int | None) -> None:
    """Refuse what is no row of numbers of the right length, before memory is taken for it."""
    if dataset.ndim != 1 or dataset.dtype.kind not in "iufb":
        raise InputError(
            f"{path}: {place}: {dataset.dtype} of shape {dataset.shape}, expected a row of float64"
        )
    if size is not None and dataset.shape[0] != size:
        raise InputError(f"{path}: {place}: {dataset.shape[0]} samples, expected the {size} of time")
    if not 2 <= dataset.shape[0] <= MAX_SAMPLES:
        raise InputError(f"{path}: {place}: {dataset.shape[0]} samples, expected 2 to {MAX_SAMPLES}")
    check_storage(dataset, f"{path}: {place}")


def check_storage(dataset: h5py.Dataset, place: str) -> None:
    """Refuse a dataset that is not stored safely, see `storage_fault`."""
    if fault := storage_fault(dataset):
        raise InputError(f"{place}: {fault}, expected its {dataset.size or 0} values in this file")


def storage_fault(dataset: h5py.Dataset) -> str:
    """Say what is wrong with the storage of a dataset: in other files, not written whole, behind filters.

    What was left out reads as zeros, and a few bytes that stand for a chunk can stand for gigabytes. Empty if
    nothing is.
    """
    if dataset.is_virtual or dataset.external:
        return "kept in other files"
    size = dataset.size or 0
    stored_bytes = dataset.id.get_storage_size()
    if stored_bytes > dataset.file.id.get_filesize():
        return f"declares {stored_bytes} bytes, more than the file has"
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]
    if dataset.chunks is None:
        written = stored_bytes // dataset.dtype.itemsize
    else:
        chunk = math.prod(dataset.chunks)
        if chunk > MAX_CHUNK or len(set(filters)) < len(filters) or not _FILTERS.issuperset(filters):
            return (
                f"chunks of {chunk} values through the filters {filters}, where at most {MAX_CHUNK} values "
                "through each of gzip, lzf, shuffle and fletcher32 at most once are read"
            )
        written = dataset.id.get_num_chunks() * chunk
    if written < size:
        return f"declared but {f'only {written} values of {size}' if written else 'never'} written"
    return ""


def _check_plain(dataset: h5py.Dataset, place: str) -> None:
    """Refuse values that some readers would scale or leave out and others would not.

    Attributes of CF and netCDF for packed values: xarray honours them, h5py does not.
    """
    for name, neutral in _PACKING.items():
        value = attribute(dataset, name) if name in dataset.attrs else neutral
        if isinstance(value, np.ndarray) or value != neutral:
            raise InputError(
                f"{place}: attribute {name}: {shown(value)}, expected the values "
                "themselves, in their units and as float64"
            )


def _check_missing_value(dataset: h5py.Dataset, values: Array, place: str, start: int) -> None:
    """Refuse an attribute by which a number stands for missing samples, if there are any."""
    for name in _MISSING:
        fill = attribute(dataset, name) if name in dataset.attrs else math.nan
        if isinstance(fill, float) and math.isnan(fill):
            continue
        hit = np.isin(values, np.asarray(fill, dtype=np.float64)) if isinstance(fill, float | int) else True
        if np.any(hit):
            raise InputError(
                f"{place}: attribute {name}: {shown(fill)} stands for missing samples, such as number "
                f"{start + int(np.argmax(hit))}, expected NaN"
            )


def _local_dataset(file: h5py.File, path: Path, place: str, name: str) -> h5py.Dataset | None:
    """Return a dataset of the file; a link might lead into any other."""
    link = file.get(name, getlink=True)
    if link is not None and not isinstance(link, h5py.HardLink):
        raise InputError(f"{path}: {place}: a link, expected the dataset itself")
    item = None if link is None else file[name]
    return item if isinstance(item, h5py.Dataset) else None
