"""The columns of one run in the archives that a map names for it."""

import math
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from fit.errors import InputError, shown
from fit.files import key
from fit.telemetry import time_axis, time_stamps
from fit.telemetry.archives import open_table
from fit.telemetry.archives.table import Table
from fit.telemetry.contract import CHANNELS
from fit.telemetry.maps import (
    SECONDS,
    TIME,
    Channel,
    Map,
    Place,
    factor_of,
    has_common_clock,
    places_of,
    places_of_run,
)
from fit.telemetry.time_axis import Stamps


@dataclass(frozen=True)
class ArchiveColumn:
    """The column of a channel.

    Attributes
    ----------
    table : Table
        Where it is.
    name : str
        In that table.
    place : str
        For messages.
    size : int
        Number of samples.
    factor : float
        From the unit of the archive to that of the contract.
    missing : list of float
        Numbers that mark missing samples, in the unit of the archive.
    is_complete : bool
        Whether the map states of this channel that no number does.
    """

    table: Table
    name: str
    place: str
    size: int
    factor: float
    missing: list[float]
    is_complete: bool


class Archives:
    """The archives of run `i` of a map; each of their tables is opened once, until `stack` is closed."""

    def __init__(self, stack: ExitStack, path: Path, mapping: Map, i: int) -> None:
        self._stack, self._path, self._map, self._i = stack, path, mapping, i
        self._tables: dict[Place, Table] = {}

    @property
    def files(self) -> list[Path]:
        """The files that were opened."""
        return list(dict.fromkeys(place.archive for place in self._tables))

    def columns(self, attributes: Mapping[str, object]) -> dict[str, ArchiveColumn]:
        """Return the columns of all channels; `attributes` of the run have the mass of a test mass.

        Raises
        ------
        InputError
            If one is missing or no row of numbers, if there are several, or if its unit is wrong.
        """
        columns = {
            name: self._column(name, channel, channel.column, attributes)
            for name, channel in self._map.channels.items()
            if channel.column is not None
        }
        users: dict[tuple[int, str], str] = {}
        for name, column in columns.items():
            other_channel = users.setdefault((id(column.table), column.name), name)
            if other_channel != name:
                raise InputError(
                    f"{column.place}: also that of channel {other_channel}, expected a column for each"
                )
        return columns

    def time(self, columns: Collection[ArchiveColumn]) -> tuple[str, Stamps] | None:
        """Return the time column beside those of the channels and its place, None without one.

        Raises
        ------
        InputError
            If it is missing, no time, or not the same in all tables that have one.
        """
        clock = self._map.time
        if clock is None:
            return None
        if has_common_clock(self._map, self._i):
            (table, name) = self._find(TIME, clock.column)
            return self._stamps(table, name)
        places = places_of_run(self._path, self._map, self._i)
        tables = dict.fromkeys([*(column.table for column in columns), *map(self._table, places)])
        having = [table for table in tables if _has(table, clock.column)]
        if shared := [table for table in having if any(table is column.table for column in columns)]:
            having = shared  # another file may have a column of this name, or number, by chance
        if not having:
            self._find(TIME, clock.column)
        place, reference = self._stamps(having[0], having[0].column(clock.column))
        for table in having[1:]:
            other_place, stamps_there = self._stamps(table, table.column(clock.column))
            time_axis.check_agreement(other_place, stamps_there, place, reference)
        return place, reference

    def _table(self, place: Place) -> Table:
        if place not in self._tables:
            self._tables[place] = self._stack.enter_context(open_table(place.archive, place.table))
        return self._tables[place]

    def _find(self, channel: str, column: str | int) -> tuple[Table, str]:
        """Return the only table that has the column of a channel, and its name there."""
        if channel == TIME and not has_common_clock(self._map, self._i):
            places = list(places_of_run(self._path, self._map, self._i))
        else:
            places = places_of(self._path, self._map, self._i, channel)
        tables = [self._table(place) for place in places]
        meaning = " (time)" if channel == TIME else f" (channel {channel})"
        if len(tables) == 1:
            return tables[0], tables[0].column(column, meaning)
        place = f"{self._path}: runs[{self._i}].file: column {key(str(column))}{meaning}"
        having = [table for table in tables if _has(table, column)]
        names = ", ".join(table.path.name for table in having or tables)
        if not having:
            cure = f'file = {{ {channel} = "{tables[0].path.name}", ... }} for columns without names'
            raise InputError(f"{place}: in none of {names}, expected it in one of them, or {cure}")
        if len(having) > 1:
            cure = f'file = "{having[0].path.name}" next to the column'
            raise InputError(f"{place}: in each of {names}, expected it in one of them; or write {cure}")
        return having[0], having[0].column(column)

    def _column(
        self, channel: str, column: Channel, key: str | int, attributes: Mapping[str, object]
    ) -> ArchiveColumn:
        table, name = self._find(channel, key)
        place = f"{table.path}: column {_key(name)} (channel {channel})"
        known = table.columns[name]
        if known.size is None or known.is_text:
            raise InputError(f"{place}: {known.reason or 'no row of numbers'}, expected a row of numbers")
        factor = factor_of(place, column.unit or known.unit or None, channel, attributes)
        if column.unit and known.unit:
            _check_units(place, column.unit, known.unit, channel, attributes)
        missing = self._map.missing if column.missing is None else column.missing
        return ArchiveColumn(table, name, place, known.size, factor, missing, column.missing == [])

    def _stamps(self, table: Table, name: str) -> tuple[str, Stamps]:
        clock = self._map.time
        assert clock is not None
        place = f"{table.path}: column {_key(name)}"
        known = table.columns[name]
        if known.size is None:
            raise InputError(f"{place}: {known.reason or 'no row of numbers'}, expected a row of times")
        unit = clock.unit if clock.unit is not None else known.unit
        if known.is_text:
            factor = factor_of(place, clock.unit, TIME, {})
            if clock.unit is not None and clock.format is None:
                raise InputError(
                    f"{place}: texts, but the map has unit = {shown(clock.unit)}, expected numbers"
                )
            return place, time_stamps.read_texts(place, table.texts(name), clock.format, clock.scale, factor)
        values = table.numbers(name)
        if clock.format is None:
            elapsed = time_stamps.read_elapsed(place, values, factor_of(place, unit or None, TIME, {}))
            return place, time_stamps.since(place, known.epoch, elapsed)
        if known.epoch:
            raise InputError(
                f"{place}: since {known.epoch!r} by the file, but of format {clock.format!r} by the map, "
                "expected no format"
            )
        stated = unit if clock.format in SECONDS else None
        factor = factor_of(place, stated or None, TIME, {})
        return place, time_stamps.read_numbers(place, values, clock.format, clock.scale, factor)


def _check_units(
    place: str, unit: str, unit_in_file: str, channel: str, attributes: Mapping[str, object]
) -> None:
    """Refuse a unit of the map other than that in the file, if the latter can be one of the channel."""
    try:
        factor = factor_of(place, unit_in_file, channel, attributes)
    except InputError:
        return  # such as counts, which the map explains
    if not math.isclose(factor, factor_of(place, unit, channel, attributes), rel_tol=1e-9):
        raise InputError(
            f"{place}: in {unit_in_file!r} by the file, but in {unit!r} by the map; expected the same, or no "
            "unit in the map"
        )


def _key(name: str) -> str:
    """Return the name of a column for a message: of a matrix as it is written, ``out[2]``."""
    return name if name.isprintable() and len(name) <= 80 else key(name)


def _has(table: Table, column: str | int) -> bool:
    try:
        table.column(column)
    except InputError:
        return False
    return True


def describe(channel: str, column: ArchiveColumn) -> tuple[str, str]:
    """Return unit and long name of a channel in the telemetry."""
    return CHANNELS[channel].unit, f"column {column.name} of {column.table.path.name}"
