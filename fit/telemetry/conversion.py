"""Archives that a map describes, written as telemetry of schema ``lpf-telemetry/1``.

What an archive holds is converted once, run by run, and passes the checks of `validation` on the way, so that
a message names the file and the column that somebody can look at. All else reads the result.
"""

import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.files import refuse_links
from fit.telemetry import time_axis, time_stamps
from fit.telemetry.archives import Table, open_table
from fit.telemetry.contract import CHANNELS, SCHEMA, check_root, required
from fit.telemetry.lazy_channels import root_attributes
from fit.telemetry.maps import (
    SECONDS,
    TIME,
    Channel,
    Clock,
    Map,
    Place,
    attributes_of,
    factor_of,
    load,
    place_of,
)
from fit.telemetry.time_axis import Stamps
from fit.telemetry.validation import MAX_SAMPLES, check_markers, check_missing, check_values, replace_markers
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
    names: set[str] = set()
    for path, i, run in ((path, i, run.run) for path, m in maps.items() for i, run in enumerate(m.runs)):
        if run in names:
            raise InputError(f"{path}: runs[{i}].run: {run!r} is also that of another, expected unique names")
        names.add(run)
    try:
        _write_all(maps, folder, any_gaps=any_gaps)
    except OSError as error:
        raise FitError(f"{folder}: cannot be written ({error.strerror}), expected a folder") from error
    runs = {path: [folder / f"{source.run}.h5" for source in mapping.runs] for path, mapping in maps.items()}
    return [file for path in dict.fromkeys(paths) for file in runs.get(path, [path])]


def _write_all(maps: Mapping[Path, Map], folder: Path, *, any_gaps: bool) -> None:
    """Write the runs of all maps in place of those of earlier conversions, or none of them."""
    existing = sorted(folder.glob("*.h5"))
    for path in existing:
        if _MARK not in (root_attributes(path) or {}):
            raise InputError(
                f"{path}: telemetry that was not converted, expected another folder to convert into"
            )
    parent = next(p for p in folder.resolve().parents if p.is_dir())
    with tempfile.TemporaryDirectory(prefix=".conversion-", dir=parent) as workspace:
        for path, mapping in maps.items():
            for i in range(len(mapping.runs)):
                with ExitStack() as stack:
                    _Run(stack, path, mapping, i).write(Path(workspace), any_gaps=any_gaps)
        folder.mkdir(parents=True, exist_ok=True)
        for file in existing:
            file.unlink()
        for file in Path(workspace).glob("*.h5"):
            file.replace(folder / file.name)


class _Run:
    """Run `i` of a map; each table of its archives is opened once, until `stack` is closed."""

    def __init__(self, stack: ExitStack, path: Path, mapping: Map, i: int) -> None:
        self._stack, self._path, self._map, self._i = stack, path, mapping, i
        self._place = f"{path}: runs[{i}]"
        self._attributes = attributes_of(path, mapping, i)
        self._tables: dict[Place, Table] = {}

    def write(self, folder: Path, *, any_gaps: bool) -> None:
        """Write the run."""
        columns = self._columns()
        places = {channel: table.place(name, channel) for channel, (table, name) in columns.items()}
        stamps = self._stamps(columns)
        channels = {channel: self._read(channel, *column) for channel, column in columns.items()}
        size = stamps[1].seconds.size if stamps else next(iter(channels.values())).size
        for channel, values in channels.items():
            if values.size != size or not 2 <= size <= MAX_SAMPLES:
                expected = f"expected as many as in others, 2 to {MAX_SAMPLES}"
                raise InputError(f"{places[channel]}: {values.size} samples, {expected}")
        time = self._time(stamps, size)
        fs = check_root(self._place, self._attributes).fs
        for channel, values in channels.items():
            check_values(places[channel], values, fs)
        if not any_gaps:
            needed = [channel for channel in required(self._map.channels) if channel in columns]
            check_missing({places[channel]: np.isnan(channels[channel]) for channel in needed}, fs)
        origins = {
            channel: f"column {name} of {table.path.name}" for channel, (table, name) in columns.items()
        }
        for channel, stated in self._map.channels.items():
            if stated.value is not None:
                factor = factor_of(self._place, stated.unit, channel, self._attributes)
                channels[channel] = np.full(size, stated.value * factor)
        described = {c: (CHANNELS[c].unit, origins.get(c, "one value, by the map")) for c in channels}
        complete = [channel for channel, stated in self._map.channels.items() if stated.missing == []]
        files = list(dict.fromkeys(place.archive for place in self._tables))
        root = self._attributes | {
            "schema": SCHEMA,
            "archive": ", ".join(file.name for file in files),
            "archive_sha256": ", ".join(map(_digest, files)),
            _MARK: self._path.name,
            "archive_map_sha256": _digest(self._path),
        }
        file = folder / f"{self._map.runs[self._i].run}.h5"
        with Writer(file, size, described, root, complete=complete) as writer:
            writer.append(time, channels)

    def _find(self, channel: str, column: Channel | Clock) -> tuple[Table, str]:
        """Return table and name of the column of a channel."""
        assert column.column is not None
        place = place_of(self._path, self._map, self._i, column)
        if place not in self._tables:
            opened = open_table(place.archive, place.table, self._map.text)
            self._tables[place] = self._stack.enter_context(opened)
        table = self._tables[place]
        return table, table.column(column.column, channel)

    def _columns(self) -> dict[str, tuple[Table, str]]:
        """Return the columns of all channels but those of one value."""
        columns = {n: self._find(n, c) for n, c in self._map.channels.items() if c.value is None}
        if not columns:
            raise InputError(f"{self._path}: channels: no column, expected one of each read-out")
        users: dict[tuple[int, str], str] = {}
        for channel, (table, name) in columns.items():
            owner = users.setdefault((id(table), name), channel)
            if owner != channel:
                place = table.place(name, channel)
                raise InputError(f"{place}: also that of channel {owner}, expected a column for each")
        return columns

    def _read(self, name: str, table: Table, column: str) -> Array:
        """Return a channel in SI, NaN where samples are missing."""
        channel, stated, place = self._map.channels[name], table.unit(column), table.place(column, name)
        factor = factor_of(place, channel.unit or stated, name, self._attributes)
        is_other = False
        if channel.unit and stated:
            with suppress(InputError):  # the map may explain units such as counts
                is_other = not math.isclose(factor, factor_of(place, stated, name, self._attributes))
        if is_other:
            expected = "expected the same, or no unit in the map"
            raise InputError(f"{place}: in {stated!r} by the file, {channel.unit!r} by the map, {expected}")
        raw = table.read(column)
        if raw.dtype == object:
            raise InputError(f"{place}: text, expected a row of numbers")
        missing = self._map.missing if channel.missing is None else channel.missing
        raw = replace_markers(raw, np.ravel(missing))
        if channel.missing != []:
            place_in_map = f"channels.{name}"
            cure = (
                f"at its top or in {place_in_map}, or missing = [] in {place_in_map} if the samples are real"
            )
            check_markers(place, name, raw, "missing = {marker} in the map, " + cure)
        return np.asarray(raw * factor)

    def _stamps(self, columns: Mapping[str, tuple[Table, str]]) -> tuple[str, Stamps] | None:
        """Return place and content of the time column, None without one; all tables with one must agree."""
        clock = self._map.time
        if clock is None:
            return None
        having = {id(t): (t, t.column(clock.column)) for t, _ in columns.values() if t.has(clock.column)}
        is_elsewhere = clock.file or clock.table is not None or not having
        times = [self._find(TIME, clock)] if is_elsewhere else list(having.values())
        first, *copies = [(table.place(name), self._read_stamps(clock, table, name)) for table, name in times]
        for place, stamps in copies:
            time_axis.check_agreement(place, stamps, *first)
        return first

    def _read_stamps(self, clock: Clock, table: Table, name: str) -> Stamps:
        values, epoch, place = table.read(name), table.columns[name].epoch, table.place(name)
        if (values.dtype == object and clock.unit) or (clock.format and epoch):
            stated = f"counts from {epoch!r}" if epoch else "texts"
            raise InputError(f"{place}: {stated}, expected neither unit nor format in [time]")
        counts = values.dtype != object and (clock.format is None or clock.format in SECONDS)
        factor = factor_of(place, clock.unit or table.unit(name) or None, TIME, {}) if counts else 1.0
        return time_stamps.read_stamps(place, values, clock.format, clock.scale, factor, epoch)

    def _time(self, place_and_stamps: tuple[str, Stamps] | None, size: int) -> Array:
        """Return the seconds since the first sample; rate and start join the attributes."""
        attributes = self._attributes
        if place_and_stamps is None:
            return np.arange(size) / float(attributes["fs"])
        place, stamps = place_and_stamps
        stated = float(attributes["fs"]) if "fs" in attributes else None
        time, fs = time_axis.fit_grid(place, stamps, stated)
        attributes["fs"] = fs
        if stamps.t0 is not None:
            if "t0" in attributes:
                time_axis.check_start(f"{self._place}.t0", str(attributes["t0"]), stamps.t0, fs)
            attributes["t0"] = stamps.t0
        elif "t0" not in attributes:
            raise InputError(f"{self._place}.t0: missing, expected UTC of the first sample, or time stamps")
        return time


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
