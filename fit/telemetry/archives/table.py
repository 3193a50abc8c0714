"""A table of an archive: columns by name, each a row of numbers or of texts."""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, quote
from fit.files import key as shown_key
from fit.telemetry.validation import LOCKED, is_locked
from fit.units import in_base_units

Array = NDArray[np.float64]

#: Words for a missing sample, beside "nan" and nothing: those of pandas, R and Excel.
MISSING = ("", "NA", "N/A", "n/a", "#N/A", "<NA>", "NULL", "null", "None", "--")
_OF_MATRIX = re.compile(r"(.+)\[\d+\]")
_UNIT = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<square>[^\[\]]+)\]|\((?P<round>(?:[^()]|\([^()]*\))+)\))\s*")


@dataclass(frozen=True)
class Column:
    """A column of an archive.

    Attributes
    ----------
    size : int or None
        Number of rows, None if the column is neither a row of numbers nor one of texts.
    unit : str or None
        As the file states it.
    reason : str
        What the column is if it is no row of numbers: "text", "an array of shape (3, 4, 5)", "an object of
        class ao". Empty for numbers.
    is_text : bool
        Whether its rows are texts.
    read : callable or None
        Returns all rows: an array of numbers with NaN for missing samples, or texts.
    epoch : str
        Of times that count from it, as in netCDF, "2016-04-16 00:00:00"; empty for others.
    source : str
        What it is a column of: the array, or the table in the file. These have an order, a file has none.
    """

    size: int | None = None
    unit: str | None = None
    reason: str = ""
    is_text: bool = False
    read: Callable[[], Any] | None = None
    source: str = ""
    epoch: str = ""


class Table:
    """One table of an archive.

    Parameters
    ----------
    path, kind : Path, str
        The archive, and what it is: "text", "HDF5".
    columns : mapping of str to Column
        By name. The names of structs and groups stand before those of what they contain, joined by dots;
        column k of a matrix `out` is ``out[k]``, counted from 1.
    headings : sequence of str, optional
        The names of the columns as a text has them, unique or not.
    """

    def __init__(
        self, path: Path, kind: str, columns: Mapping[str, Column], headings: Sequence[str] = ()
    ) -> None:
        self.path, self.kind, self._headings = path, kind, headings
        self.columns = {
            name: column if column.unit else replace(column, unit=split_unit(name)[1])
            for name, column in columns.items()
        }
        self._order = _order(self.columns)

    def numbers(self, name: str) -> Array:
        """Return a column of numbers, NaN for missing samples."""
        return np.asarray(self._rows(name, "numbers"), dtype=np.float64)

    def texts(self, name: str) -> list[str]:
        """Return a column as texts, empty for missing ones."""
        return [_text(value) for value in self._rows(name, "texts")]

    def _rows(self, name: str, expected: str) -> Any:
        column = self.columns[name]
        if column.read is None or column.is_text is not (expected == "texts"):
            known = column.reason or "numbers"
            raise InputError(f"{self.path}: column {shown_key(name)}: {known}, expected {expected}")
        try:
            return column.read()
        except InputError:
            raise
        except Exception as error:  # as when the file was opened
            raise read_error(self.path, error, self.kind) from error

    def column(self, key: str | int, meaning: str = "") -> str:
        """Return the name of a column.

        Parameters
        ----------
        key : str or int
            Its name, its name without the unit in brackets that follows, or its number, counted from 1.
        meaning : str
            What the column is for, as the message has it after the key, such as " (channel o_1)".

        Raises
        ------
        InputError
            If there is no such column, or several.
        """
        if isinstance(key, int):
            return self._by_number(key, meaning)
        if key in self.columns:
            return key
        place = f"{self.path}: column {shown_key(key)}{meaning}"
        same_spelling = self._same_spelling(key)
        if len(same_spelling) == 1:
            return same_spelling[0]
        if same_spelling:
            raise InputError(
                f"{place}: there are several, expected one of the columns: {_listed(same_spelling)}"
            )
        self._check_container(key, place)
        if count := sum(name.startswith(f"{key}[") for name in self.columns):
            raise InputError(f"{place}: a matrix, expected one of its columns, {key}[1] to {key}[{count}]")
        names = {split_unit(name)[0].casefold(): name for name in self.columns}
        close = difflib.get_close_matches(key.casefold(), names, n=1)
        hint = f'; did you mean "{names[close[0]]}"?' if close else ""
        raise InputError(f"{place}: missing, expected it among the columns: {_listed(self.columns)}{hint}")

    def _check_container(self, key: str, place: str) -> None:
        """Refuse a key whose beginning is the name of what cannot be read."""
        path = key.strip("/").replace("/", ".").split(".")
        for name in (".".join(path[:n]) for n in range(len(path) - 1, 0, -1)):
            if name in self.columns and self.columns[name].size is None:
                raise InputError(f"{place}: {shown_key(name)} is {self.columns[name].reason}")

    def _by_number(self, number: int, meaning: str) -> str:
        place, available = f"{self.path}: column {number}{meaning}", _listed(self.columns)
        if not self._order:
            raise InputError(f"{place}: columns have no order here, expected a name; there are: {available}")
        if not 1 <= number <= len(self._order):
            raise InputError(f"{place}: missing, expected a number from 1 to {len(self._order)}: {available}")
        return self.column(self._order[number - 1], meaning)

    def _same_spelling(self, key: str) -> list[str]:
        """Return the columns that a key means without being their name."""
        if as_written := [
            name for name, heading in zip(self.columns, self._headings, strict=False) if heading == key
        ]:
            return as_written
        path = key.strip("/").replace("/", ".")  # as HDF5 writes it
        return [name for name in self.columns if path in (name, split_unit(name)[0])]


def _order(columns: Mapping[str, Column]) -> list[str]:
    """Return the columns of one source, a matrix among them as one; nothing for several sources."""
    if len({column.source for column in columns.values()}) > 1:
        return []
    matrices = {name: match[1] for name in columns if (match := _OF_MATRIX.fullmatch(name))}
    if len(set(matrices.values())) == 1 and len(matrices) == len(columns):
        return list(columns)
    return list(dict.fromkeys(matrices.get(name, name) for name in columns))


def _text(value: object) -> str:
    """Return a text as str; MATLAB and FITS fill it up with blanks."""
    text = value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)
    text = text.rstrip("\x00 ")
    return "" if text == "NaT" else text


def split_unit(name: str) -> tuple[str, str | None]:
    """Return a name without the unit in brackets at its end, and that unit.

    Examples
    --------
    >>> split_unit("x12 [nm]"), split_unit("a1 (pm/s^2)"), split_unit("out[2]"), split_unit("x (raw)")
    (('x12', 'nm'), ('a1', 'pm/s^2'), ('out[2]', None), ('x (raw)', None))
    """
    match = _UNIT.fullmatch(name)
    if match is None:
        return name, None
    unit = (match["square"] or match["round"]).strip()
    if unit.isdecimal() or (match["square"] is None and not is_unit(unit)):
        return name, None
    return match["name"], None if unit in ("", "-") else unit


def clean_unit(text: str) -> str | None:
    """Return a unit without brackets around it, as LTPDA writes them; None if it says that there is none."""
    unit = text.strip()
    if unit and unit[0] + unit[-1] in ("[]", "()"):
        unit = unit[1:-1].strip()
    return None if unit in ("-", "1", *MISSING) else unit


def is_unit(text: str) -> bool:
    """Return whether a text is a unit that is known."""
    try:
        in_base_units(text)
    except ValueError:
        return False
    return True


def read_error(path: Path, error: Exception, kind: str) -> InputError:
    """Return the error for a file that a library cannot read as what it should be."""
    if is_locked(error):
        return InputError(f"{path}: is {LOCKED}, expected a file that can be read")
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return InputError(f"{path}: {error.strerror}, expected a file that can be read")
    if isinstance(error, MemoryError):
        return InputError(f"{path}: takes more memory than there is to be read, expected less")
    return InputError(f"{path}: cannot be read as {kind}, expected a whole file of this format")


def _listed(names: Iterable[str]) -> str:
    text = ", ".join(name if name.isprintable() else quote(name) for name in names) or "there are none"
    return text if len(text) <= 200 else f"{text[:200]} ..."
