"""The datasets of a telemetry file, checked against the contract while they are read.

Every function raises `fit.errors.InputError`; its message names the file, the place and what was expected.
"""

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.units import REQUIRED, expected_unit, same_unit

MAX_SAMPLES = 2**28  # 310 days at 10 Hz; a file that declares more is damaged
MAX_MISSING = 0.01  # share of the samples that may be missing in the channels a calibration needs
MAX_GAP = 600.0  # s


def plain(value: object) -> object:
    """Return an attribute as str or scalar where it is one, be it bytes, NumPy scalar or 1-element array."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(())[()]
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    return value.item() if isinstance(value, np.generic) else value


def read_time(file: h5py.File, path: Path, fs: float, part: slice) -> NDArray[np.float64]:
    """Return a part of the time axis [s], checked to be uniform with steps of 1/fs."""
    dataset = file.get("time")
    if not isinstance(dataset, h5py.Dataset):
        raise InputError(f"{path}: time: missing, expected the seconds since t0")
    units = plain(dataset.attrs.get("units", "s"))
    if units not in ("s", "sec", "second", "seconds"):
        raise InputError(f"{path}: time: units {units!r}, expected 's'")
    _check_size(dataset, path, "time", None)
    time = np.asarray(dataset[part], dtype=np.float64)
    check_time(f"{path}: time", time, fs, part.start or 0)
    return time


def check_time(place: str, time: NDArray[np.float64], fs: float, start: int = 0) -> None:
    """Refuse a time axis [s] that is not uniform with steps of 1/fs; its first sample has number `start`."""
    check_finite(place, time, start)
    step = np.diff(time)
    # A jitter of a thousandth of a sample, and a clock right to 1e-6, leave every estimate where it is.
    uneven = np.flatnonzero(np.abs(step * fs - 1) > 1e-3)
    if uneven.size and np.ptp(step) * fs <= 2e-3:
        raise InputError(f"{place}: steps of {step[0]:g} s, expected 1/fs = {1 / fs:g} s")
    if uneven.size:
        n = int(uneven[0])
        raise InputError(
            f"{place}: from {time[n]:.10g} s to {time[n + 1]:.10g} s at sample {start + n + 1}, "
            f"expected uniform steps of 1/fs = {1 / fs:g} s"
        )
    span = (time.size - 1) / fs
    if abs(time[-1] - time[0] - span) > 1e-6 * span + 1e-3 / fs:
        raise InputError(f"{place}: spans {time[-1] - time[0]:.10g} s, expected (N-1)/fs = {span:.10g} s")


def check_finite(place: str, values: NDArray[np.float64], start: int = 0) -> None:
    """Refuse a value that is missing or infinite; the first one has number `start`."""
    if not np.isfinite(values).all():
        n = int(np.argmin(np.isfinite(values)))
        raise InputError(f"{place}: {values[n]} at sample {start + n}, expected a finite value")


def channel_units(file: h5py.File, path: Path, size: int) -> dict[str, str]:
    """Return the channels on a time axis of `size` samples and their units as written.

    What the contract knows is checked, but for the values.
    """
    units: dict[str, str] = {}
    for name in (*REQUIRED, *(key for key in file if key not in {"time", *REQUIRED})):
        dataset = file.get(name)
        expected = expected_unit(name)
        if not isinstance(dataset, h5py.Dataset):
            if name in REQUIRED:
                raise InputError(f"{path}: channel {name}: missing, expected for a calibration")
            continue
        if expected is None and not _is_channel(dataset):
            continue
        found = plain(dataset.attrs.get("units", ""))
        if expected is not None and not (isinstance(found, str) and same_unit(found, expected)):
            stated = f"units {found!r}" if "units" in dataset.attrs else "without units"
            raise InputError(f"{path}: channel {name}: {stated}, expected {expected!r}")
        _check_size(dataset, path, f"channel {name}", size)
        units[name] = str(found)
    return units


def read_channel(file: h5py.File, path: Path, name: str, part: slice, fs: float) -> NDArray[np.float64]:
    """Return a part of a channel; a missing sample is NaN, an infinite one is refused."""
    values = np.asarray(file[name][part], dtype=np.float64)
    check_values(f"{path}: channel {name}", values, fs, part.start or 0)
    return values


def check_values(place: str, values: NDArray[np.float64], fs: float, start: int = 0) -> None:
    """Refuse an infinite value; the first one has number `start`."""
    if np.isinf(values).any():
        n = int(np.argmax(np.isinf(values)))
        raise InputError(
            f"{place}: {values[n]} at sample {start + n} (t = {(start + n) / fs:.10g} s), "
            "expected a finite value"
        )


def check_missing(missing: Mapping[str, NDArray[np.bool_]], fs: float) -> None:
    """Refuse more missing samples than may be masked in what a calibration needs, given by place."""
    together = np.any(list(missing.values()), axis=0)
    present = np.flatnonzero(~together)
    longest = int(np.diff(present, prepend=-1, append=together.size).max()) - 1
    share = float(together.mean())
    if share <= MAX_MISSING and longest <= MAX_GAP * fs:
        return
    worst = max(missing, key=lambda place: int(missing[place].sum()))
    first = int(np.argmax(missing[worst]))
    raise InputError(
        f"{worst}: nan from sample {first} (t = {first / fs:.10g} s) on, "
        f"{100 * share:.3g} % of the samples are missing with gaps of up to {longest / fs:.6g} s, "
        f"expected at most {100 * MAX_MISSING:g} % and {MAX_GAP:g} s"
    )


def _is_channel(dataset: h5py.Dataset) -> bool:
    """Tell whether an unknown dataset lies on the time axis: 1-D, real numbers, on no other dimension."""
    if dataset.ndim != 1 or dataset.dtype.kind not in "iufb" or dataset.is_scale:
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
    if dataset.id.get_storage_size() == 0:
        raise InputError(f"{path}: {place}: declared but never written, expected {dataset.shape[0]} samples")
