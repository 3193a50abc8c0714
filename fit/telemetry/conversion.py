"""Archives that a map describes, written as telemetry of schema ``lpf-telemetry/1``.

What an archive holds is converted once, run by run, and passes the checks of `validation` on the way, so that
a message names the file and the column that somebody can look at. All else reads the result.
"""

import hashlib
import math
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError, InputError
from fit.files import key, refuse_links
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
    places_of,
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


@dataclass(frozen=True)
class _Column:
    """The column of a channel: table, name in it, place for messages."""

    table: Table
    name: str
    place: str

    @classmethod
    def find(cls, table: Table, column: str | int, channel: str) -> "_Column":
        """Find it by its name or number."""
        meaning = "" if channel == TIME else f" (channel {channel})"
        name = table.column(column, meaning)
        shown_name = name if name.isprintable() and len(name) <= 80 else key(name)  # of a matrix out[2]
        return cls(table, name, f"{table.path}: column {shown_name}{meaning}")


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
        stamps = self._stamps(columns)
        channels = {name: self._read(name, column) for name, column in columns.items()}
        size = stamps[1].seconds.size if stamps else next(iter(channels.values())).size
        for name, values in channels.items():
            if values.size != size or not 2 <= size <= MAX_SAMPLES:
                expected = f"expected as many as in others, 2 to {MAX_SAMPLES}"
                raise InputError(f"{columns[name].place}: {values.size} samples, {expected}")
        time = self._time(stamps, size)
        fs = check_root(self._place, self._attributes).fs
        for name, values in channels.items():
            check_values(columns[name].place, values, fs)
        if not any_gaps:
            needed = [name for name in required(self._map.channels) if name in columns]
            check_missing({columns[name].place: np.isnan(channels[name]) for name in needed}, fs)
        names = {
            name: f"column {column.name} of {column.table.path.name}" for name, column in columns.items()
        }
        for name, channel in self._map.channels.items():
            if channel.value is not None:
                factor = factor_of(self._place, channel.unit, name, self._attributes)
                channels[name] = np.full(size, channel.value * factor)
        described = {
            name: (CHANNELS[name].unit, names.get(name, "one value, by the map")) for name in channels
        }
        complete = [name for name, channel in self._map.channels.items() if channel.missing == []]
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

    def _find(self, channel: str, column: Channel | Clock) -> _Column:
        """Return the column of a channel in the only table that has it."""
        assert column.column is not None
        tables = []
        for place in places_of(self._path, self._map, self._i, column):
            if place not in self._tables:
                opened = open_table(place.archive, place.table, self._map.text)
                self._tables[place] = self._stack.enter_context(opened)
            tables.append(self._tables[place])
        having = [table for table in tables if table.has(column.column)] if len(tables) > 1 else tables
        if len(having) != 1:
            names = ", ".join(table.path.name for table in having or tables)
            raise InputError(
                f"{self._place}.file: column {key(str(column.column))} (channel {channel}): in "
                f"{'each' if having else 'none'} of {names}, expected it in one of them, or its file: "
                f'{{ column = {column.column!r}, file = "{(having or tables)[0].path.name}" }}'
            )
        return _Column.find(having[0], column.column, channel)

    def _columns(self) -> dict[str, _Column]:
        """Return the columns of all channels but those of one value."""
        columns = {
            name: self._find(name, channel)
            for name, channel in self._map.channels.items()
            if channel.value is None
        }
        if not columns:
            raise InputError(f"{self._path}: channels: no column, expected one of each read-out")
        users: dict[tuple[int, str], str] = {}
        for name, column in columns.items():
            other = users.setdefault((id(column.table), column.name), name)
            if other != name:
                raise InputError(f"{column.place}: also that of channel {other}, expected a column for each")
        return columns

    def _read(self, name: str, column: _Column) -> Array:
        """Return a channel in SI, NaN where samples are missing."""
        channel, stated = self._map.channels[name], column.table.unit(column.name)
        factor = factor_of(column.place, channel.unit or stated, name, self._attributes)
        if channel.unit and stated:
            with suppress(InputError):  # the map may explain units such as counts
                if not math.isclose(factor, factor_of(column.place, stated, name, self._attributes)):
                    stated = None
            if stated is None:
                raise InputError(
                    f"{column.place}: in another unit by the file than {channel.unit!r} of the map, expected "
                    "the same, or no unit in the map"
                )
        raw = column.table.read(column.name)
        if raw.dtype == object:
            raise InputError(f"{column.place}: text, expected a row of numbers")
        missing = self._map.missing if channel.missing is None else channel.missing
        raw = replace_markers(raw, np.ravel(missing))
        if channel.missing != []:
            cure = (
                "missing = {marker} in the map, at its top or in channels.%s, or missing = [] in channels.%s"
            )
            check_markers(column.place, name, raw, f"{cure % (name, name)} if the samples are real")
        return np.asarray(raw * factor)

    def _stamps(self, columns: Mapping[str, _Column]) -> tuple[str, Stamps] | None:
        """Return place and content of the time column, None without one; all tables with one must agree."""
        clock = self._map.time
        if clock is None:
            return None
        having = {id(c.table): c.table for c in columns.values() if c.table.has(clock.column)}
        if clock.file or clock.table is not None or not having:
            found = [self._find(TIME, clock)]
        else:
            found = [_Column.find(table, clock.column, TIME) for table in having.values()]
        first, *others = [(column.place, self._read_stamps(clock, column)) for column in found]
        for place, stamps in others:
            time_axis.check_agreement(place, stamps, *first)
        return first

    def _read_stamps(self, clock: Clock, column: _Column) -> Stamps:
        values, epoch = column.table.read(column.name), column.table.columns[column.name].epoch
        if (values.dtype == object and clock.unit) or (clock.format and epoch):
            stated = f"counts from {epoch!r}" if epoch else "texts"
            raise InputError(f"{column.place}: {stated}, expected neither unit nor format in [time]")
        counts = values.dtype != object and (clock.format is None or clock.format in SECONDS)
        unit = clock.unit or column.table.unit(column.name)
        factor = factor_of(column.place, unit or None, TIME, {}) if counts else 1.0
        return time_stamps.read_stamps(column.place, values, clock.format, clock.scale, factor, epoch)

    def _time(self, place_and_stamps: tuple[str, Stamps] | None, size: int) -> Array:
        """Return the seconds since the first sample; rate and start join the attributes."""
        attributes = self._attributes
        if place_and_stamps is None:
            return np.arange(size) / float(attributes["fs"])
        place, stamps = place_and_stamps
        time, rate = time_axis.fit_grid(
            place, stamps, float(attributes["fs"]) if "fs" in attributes else None
        )
        attributes.setdefault("fs", rate)
        if stamps.t0 is not None:
            if "t0" in attributes:
                time_axis.check_start(f"{self._place}.t0", str(attributes["t0"]), stamps, rate)
            attributes["t0"] = stamps.t0
        elif "t0" not in attributes:
            raise InputError(f"{self._place}.t0: missing, expected UTC of the first sample, or time stamps")
        return time


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
