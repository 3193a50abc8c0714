"""Archives that a map describes, written as telemetry of schema ``lpf-telemetry/1``.

What an archive holds is converted once, run by run, and passes the checks of `validation` on the way, so that
a message names the file and the column that somebody can look at. All else reads the result.
"""

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.files import refuse_links
from fit.telemetry import time_axis
from fit.telemetry.archive_columns import ArchiveColumn, Archives, describe
from fit.telemetry.contract import CHANNELS, SCHEMA, check_root, required
from fit.telemetry.maps import Map, attributes_of, factor_of, load
from fit.telemetry.missing_markers import check_markers, replace_markers
from fit.telemetry.time_axis import Stamps
from fit.telemetry.validation import MAX_SAMPLES, check_missing, check_values
from fit.telemetry.writer import Writer

Array = NDArray[np.float64]

_MARK = "archive_map"  # the attribute that only a converted file has


def is_map(path: Path) -> bool:
    """Return whether a path is meant to be a map."""
    return path.suffix == ".toml"


def convert(paths: Sequence[Path], folder: Path, *, any_gaps: bool) -> list[Path]:
    """Convert what maps describe.

    Parameters
    ----------
    paths : sequence of Path
        Maps, ``*.toml``, and other paths.
    folder : Path
        Where ``RUN.h5`` of every run goes; it is made, and what an earlier conversion left there is replaced.
    any_gaps : bool
        Let a run pass however much of it is missing, not only what a calibration masks.

    Returns
    -------
    list of Path
        The paths, with the files of its runs in the place of each map.

    Raises
    ------
    InputError
        If a map or an archive is at fault, or `folder` is a link or holds telemetry that was not converted;
        nothing is written then.
    FitError
        If a file cannot be written.
    """
    maps = {path: load(path) for path in dict.fromkeys(paths) if is_map(path)}
    if not maps:
        return list(paths)
    refuse_links(folder)
    places: dict[str, str] = {}
    for path, mapping in maps.items():
        for i, source in enumerate(mapping.runs):
            place = f"{path}: runs[{i}]"
            twin = places.setdefault(source.run, place)
            if twin is not place:
                raise InputError(f"{place}.run: {source.run!r} is also that of {twin}, expected unique names")
    try:
        _write_all(maps, folder, any_gaps=any_gaps)
    except OSError as error:
        raise FitError(f"{folder}: cannot be written ({error.strerror}), expected a folder") from error
    runs = {path: [folder / f"{source.run}.h5" for source in mapping.runs] for path, mapping in maps.items()}
    return [file for path in dict.fromkeys(paths) for file in runs.get(path, [path])]


def _write_all(maps: Mapping[Path, Map], folder: Path, *, any_gaps: bool) -> None:
    """Write the runs of all maps in place of those of earlier conversions, or none of them."""
    existing = _converted(folder)
    parent = next(p for p in folder.resolve().parents if p.is_dir())
    with tempfile.TemporaryDirectory(prefix=".conversion-", dir=parent) as workspace:
        for path, mapping in maps.items():
            for i in range(len(mapping.runs)):
                _write(path, mapping, i, Path(workspace), any_gaps=any_gaps)
        folder.mkdir(parents=True, exist_ok=True)
        for file in existing:
            file.unlink()
        for file in Path(workspace).glob("*.h5"):
            file.replace(folder / file.name)


def _converted(folder: Path) -> list[Path]:
    """Return the telemetry in a folder, which must come from conversions."""
    files = sorted(folder.glob("*.h5"))
    for path in files:
        if h5py.is_hdf5(path):
            with h5py.File(path) as file:
                if _MARK in file.attrs:
                    continue
        raise InputError(f"{path}: telemetry that was not converted, expected another folder to convert into")
    return files


def _write(path: Path, mapping: Map, i: int, folder: Path, *, any_gaps: bool) -> None:
    """Write one run."""
    attributes = attributes_of(path, mapping, i)
    with ExitStack() as stack:
        archives = Archives(stack, path, mapping, i)
        columns = archives.columns(attributes)
        clock = archives.time(columns.values())
        if not columns:
            raise InputError(f"{path}: channels: no column, expected one of each read-out")
        first = next(iter(columns.values()))
        size = clock[1].seconds.size if clock else first.size
        for column in columns.values():
            if column.size != size:
                raise InputError(f"{column.place}: {column.size} samples, expected {size} as in others")
        if not 2 <= size <= MAX_SAMPLES:
            raise InputError(f"{first.table.path}: {size} samples, expected 2 to {MAX_SAMPLES}")
        time = _time(f"{path}: runs[{i}]", clock, attributes, size)
        fs = check_root(f"{path}: runs[{i}]", attributes).fs
        origin = {
            "schema": SCHEMA,
            "archive": ", ".join(file.name for file in archives.files),
            "archive_sha256": ", ".join(map(_digest, archives.files)),
            _MARK: path.name,
            "archive_map_sha256": _digest(path),
        }
        channels = {name: _read_channel(name, column, fs) for name, column in columns.items()}
        if not any_gaps:
            needed = (name for name in required(mapping.channels) if name in columns)
            check_missing({columns[name].place: np.isnan(channels[name]) for name in needed}, fs)
        described = {name: describe(name, column) for name, column in columns.items()}
        for name, channel in mapping.channels.items():
            if channel.value is not None:
                factor = factor_of(f"{path}: channels.{name}.unit", channel.unit, name, attributes)
                channels[name] = np.full(size, channel.value * factor)
                described[name] = CHANNELS[name].unit, "one value, by the map"
        complete = [name for name, column in columns.items() if column.is_complete]
        root = {**attributes, **origin}
        path_of_run = folder / f"{mapping.runs[i].run}.h5"
        with Writer(path_of_run, size, described, root, complete=complete) as writer:
            writer.append(time, channels)


def _time(
    run: str,
    clock: tuple[str, Stamps] | None,
    attributes: dict[str, str | int | float],
    size: int,
) -> Array:
    """Return the seconds since the first sample; rate and start join the attributes of a `run`."""
    fs = None
    if "fs" in attributes:
        fs = check_root(run, {"t0": "2000-01-01T00:00:00Z", **attributes}).fs
    if clock is None:
        return np.arange(size) / float(attributes["fs"])
    place, column = clock
    time, rate = time_axis.fit_grid(place, column, fs)
    attributes.setdefault("fs", rate)
    if column.t0 is not None:
        if "t0" in attributes:
            time_axis.check_start(f"{run}.t0", str(attributes["t0"]), column, rate)
        attributes["t0"] = column.t0
    elif "t0" not in attributes:
        raise InputError(
            f"{run}.t0: missing, expected the UTC of the first sample, or time stamps with a format in [time]"
        )
    return time


def _read_channel(name: str, column: ArchiveColumn, fs: float) -> Array:
    """Return a channel in SI, NaN where samples are missing."""
    raw = replace_markers(column.table.numbers(column.name), column.missing)
    cure = (
        f"missing = {{marker}} in the map, at its top or in channels.{name}, "
        f"or missing = [] in channels.{name} if the samples are real"
    )
    check_markers(column.place, name, raw, fs, is_complete=column.is_complete, cure=cure)
    values = raw * column.factor
    check_values(column.place, values, fs)
    return values


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
