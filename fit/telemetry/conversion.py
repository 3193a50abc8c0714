"""Archives that a map describes, written as telemetry of schema ``lpf-telemetry/1``.

What an archive holds is converted once, run by run and in blocks, and passes the checks of `datasets` on
the way, so that a message names the file and the column that somebody can look at. All else reads the result.
"""

import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError
from fit.files import key, refuse_links
from fit.telemetry import guard
from fit.telemetry.archives import Table, is_text, look, opened
from fit.telemetry.contract import CHANNELS, REQUIRED, SCHEMA, check_root
from fit.telemetry.datasets import MAX_SAMPLES, check_finite, check_missing, check_time, check_values
from fit.telemetry.maps import Column, Map, attributes_of, check_unit, load
from fit.telemetry.writer import Writer

Array = NDArray[np.float64]

_MARK = "archive_map"  # the attribute that only a converted file has


def is_map(path: Path) -> bool:
    """Tell whether a path is meant to be a map."""
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
    for path, found in maps.items():
        for i, source in enumerate(found.runs):
            place = f"{path}: runs[{i}]"
            twin = places.setdefault(source.run, place)
            if twin is not place:
                raise InputError(f"{place}.run: {source.run!r} is also that of {twin}, expected unique names")
    archives = {p.parent / source.file: source.table for p, found in maps.items() for source in found.runs}
    guard.check(look, [path for path in archives if not is_text(path)], archives)
    earlier = _converted(folder)
    above = next(p for p in folder.resolve().parents if p.is_dir())
    with tempfile.TemporaryDirectory(prefix=".conversion-", dir=above) as made:
        for path, found in maps.items():
            for i in range(len(found.runs)):
                _write(path, found, i, Path(made), any_gaps=any_gaps)
        folder.mkdir(parents=True, exist_ok=True)
        for file in earlier:
            file.unlink()
        for run in places:
            (Path(made) / f"{run}.h5").replace(folder / f"{run}.h5")
    runs = {path: [folder / f"{source.run}.h5" for source in found.runs] for path, found in maps.items()}
    return [file for path in dict.fromkeys(paths) for file in runs.get(path, [path])]


def _converted(folder: Path) -> list[Path]:
    """Return the telemetry in a folder, which must come from conversions."""
    files = sorted(folder.glob("*.h5"))
    for path in files:
        if h5py.is_hdf5(path):
            with h5py.File(path) as file:
                if _MARK in file.attrs:
                    continue
        raise InputError(f"{path}: telemetry that was not converted, expected another --out than its folder")
    return files


@dataclass(frozen=True)
class _Found:
    """A column that a map names: its place for messages, its length, its SI unit and the factor to that."""

    name: str
    place: str
    size: int
    unit: str
    factor: float


def _write(path: Path, found: Map, i: int, folder: Path, *, any_gaps: bool) -> None:
    """Write one run."""
    source = found.runs[i]
    archive = path.parent / source.file
    with opened(archive, source.table) as table:
        columns = {
            name: _find(archive, table, column, f" (channel {name})", CHANNELS[name].unit)
            for name, column in found.channels.items()
        }
        attributes = attributes_of(path, found, i)
        clock = None if found.time is None else _find(archive, table, found.time, "", "s")
        size = (clock or columns["o_1"]).size
        for column in columns.values():
            if column.size != size:
                raise InputError(f"{column.place}: {column.size} samples, expected {size} as in others")
        if not 2 <= size <= MAX_SAMPLES:
            raise InputError(f"{archive}: {size} samples, expected 2 to {MAX_SAMPLES}")
        if clock is None:
            time = np.arange(size) / float(attributes["fs"])
        else:
            time = _time(table, clock)
            attributes.setdefault("fs", _rate(time, clock.place))
        fs = check_root(f"{path}: runs[{i}]", attributes).fs
        check_time(clock.place if clock else str(archive), time, fs)
        described = {name: (c.unit, f"column {c.name} of {archive.name}") for name, c in columns.items()}
        origin = {
            "schema": SCHEMA,
            "archive": archive.name,
            "archive_sha256": _digest(archive),
            _MARK: path.name,
            "archive_map_sha256": _digest(path),
        }
        with Writer(folder / f"{source.run}.h5", size, described, {**attributes, **origin}) as writer:
            missing = _copy(table, columns, writer, time, fs)
            if not any_gaps:
                check_missing(missing, fs)


def _copy(
    table: Table, columns: Mapping[str, _Found], writer: Writer, time: Array, fs: float
) -> dict[str, NDArray[np.bool_]]:
    """Copy the channels; return by place which samples are missing in what a calibration needs."""
    missing = {columns[name].place: np.zeros(time.size, dtype=bool) for name in REQUIRED}
    start = 0
    for block in table.blocks([column.name for column in columns.values()]):
        values = {
            name: raw * column.factor for (name, column), raw in zip(columns.items(), block, strict=True)
        }
        stop = start + block[0].size
        for name, column in columns.items():
            check_values(column.place, values[name], fs, start)
            if name in REQUIRED:
                missing[column.place][start:stop] = np.isnan(values[name])
        writer.append(time[start:stop], values)
        start = stop
    return missing


def _find(archive: Path, table: Table, column: Column, meaning: str, unit: str) -> _Found:
    """Look up a column; `meaning` says what it is for, `unit` is the one of the contract."""
    place = f"{archive}: column {key(column.column)}{meaning}"
    name = table.column(column.column, meaning)
    there = table.columns[name]
    if there.size is None or there.text:
        raise InputError(f"{place}: {there.reason}, expected a row of numbers")
    stated = column.unit if column.unit is not None else there.unit
    return _Found(name, place, there.size, unit, check_unit(place, stated or None, unit))


def _time(table: Table, clock: _Found) -> Array:
    """Return the seconds since the first sample."""
    raw = np.concatenate([block for (block,) in table.blocks([clock.name])])
    check_finite(clock.place, raw)
    return np.asarray((raw - raw[0]) * clock.factor)


def _rate(time: Array, place: str) -> float:
    """Return the sample rate [Hz]: a round one, or that of a round period, if the mean is that."""
    if not time[-1] > time[0]:
        raise InputError(f"{place}: from {time[0]:g} s to {time[-1]:g} s, expected it to increase")
    mean = (time.size - 1) / float(time[-1])
    round_ones = (float(f"{mean:.5g}"), 1 / float(f"{1 / mean:.5g}"))
    return next((fs for fs in round_ones if math.isclose(fs, mean, rel_tol=1e-6)), mean)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
