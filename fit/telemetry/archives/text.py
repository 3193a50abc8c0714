"""Text: lines of cells separated by tabs, semicolons, commas or blanks, in any encoding."""

import bz2
import codecs
import gzip
import io
import lzma
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, TextIO, cast

import numpy as np

from fit.errors import InputError, shown
from fit.files import key
from fit.telemetry.archives.table import Array, Column, Table
from fit.telemetry.archives.text_layout import detect_layout, is_data, number, split_numbered, unique_names

_PACKED = {".gz": b"\x1f\x8b", ".bz2": b"BZh", ".xz": b"\xfd7zXZ\x00"}
SUFFIXES = tuple(
    f"{kind}{pack}" for kind in (".csv", ".tsv", ".txt", ".dat", ".asc") for pack in ("", *_PACKED)
)
_BINARY = {b"PK\x03\x04": "an archive of ZIP, as Excel's .xlsx is", b"\x89HDF": "HDF5", b"SIMPLE  =": "FITS"}
_BOMS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",  # before UTF-16, whose mark it begins with
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_HEAD = 2**16  # bytes that show the encoding
_LONGEST_LINE = 2**20  # letters
_LONGEST_HEADER = 4 * _LONGEST_LINE
_SAMPLE = 200  # lines that show the layout
_BLOCK = 2**14  # lines that are split at a time


@contextmanager
def open_table(path: Path, table: str | int | None) -> Iterator[Table]:
    """Open a text."""
    if table is not None:
        raise InputError(f"{path}: no table {table!r}, expected none to be named in a file of one table")
    with _unpacked(path) as binary:
        head = binary.read(_HEAD)
        for magic, kind in _BINARY.items():
            if head.startswith(magic):
                raise InputError(f"{path}: {kind}, expected text as its name says")
        binary.seek(0)
        # Letters of another encoding in columns that nobody reads do no harm.
        with io.TextIOWrapper(binary, encoding=_encoding(head), errors="replace") as file:
            table_of_file = _read_table(file, path)
        yield table_of_file


def _unpacked(path: Path) -> IO[bytes]:
    with path.open("rb") as file:
        head = file.read(8)
    if head.startswith(_PACKED[".gz"]):
        return cast(IO[bytes], gzip.open(path))
    if head.startswith(_PACKED[".bz2"]):
        return cast(IO[bytes], bz2.open(path))
    if head.startswith(_PACKED[".xz"]):
        return lzma.open(path)
    return path.open("rb")


def _encoding(head: bytes) -> str:
    """Return the encoding of a text from its first bytes."""
    marked = next((encoding for bom, encoding in _BOMS.items() if head.startswith(bom)), None)
    if marked:
        return marked
    zeros = [head[i::2].count(0) for i in (0, 1)]
    if 4 * sum(zeros) > len(head):  # digits and delimiters have one in UTF-16
        return "utf-16-le" if zeros[1] > zeros[0] else "utf-16-be"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


class _Cells:
    """The cells of a column while its text is read.

    Of a column of numbers a cell that is none is remembered, and refused when the column is used.
    """

    def __init__(self, path: Path, name: str, decimal: str, *, is_text: bool) -> None:
        self.path, self.name, self._decimal, self._is_text = path, name, decimal, is_text
        self._rows: list[str] = []
        self._numbers: list[Array] = []
        self._fault: InputError | None = None

    def append(self, cells: Sequence[str], lines: Sequence[int]) -> None:
        """Take the cells of further lines."""
        if self._is_text:
            self._rows += [cell.strip() for cell in cells]
            return
        try:
            if self._decimal == "." and not any("_" in cell for cell in cells):  # Python reads 1_0 as 10
                self._numbers.append(np.array([float(cell) for cell in cells]))
                return
        except ValueError:  # an empty cell is a missing sample
            pass
        values = [number(cell, self._decimal) for cell in cells]
        if None in values and self._fault is None:
            n = values.index(None)
            mark = "point" if self._decimal == "." else "comma, as others have"
            self._fault = InputError(
                f"{self.path}: line {lines[n]}: column {key(self.name)}: {shown(cells[n])}, expected a "
                f"number with a decimal {mark}, or nothing"
            )
        self._numbers.append(np.array(values, dtype=np.float64))

    def column(self, size: int, unit: str | None) -> Column:
        """Return the column of the first `size` cells."""
        if self._is_text:
            return Column(size, unit, "text", True, lambda: self._rows[:size])
        return Column(size, unit, read=lambda: self._read(size))

    def _read(self, size: int) -> Array:
        if self._fault is not None:
            raise self._fault
        return np.concatenate([np.zeros(0), *self._numbers])[:size]


def _read_table(file: TextIO, path: Path) -> Table:
    """Read a text, once for its layout and once for its cells."""
    layout = detect_layout(path, list(_sample(path, file)))
    names = unique_names(layout.names)
    columns = [
        _Cells(path, name, layout.decimal, is_text=is_text)
        for name, is_text in zip(names, layout.is_text, strict=True)
    ]
    count = size = 0
    rows = (
        line
        for line in _numbered(path, file)
        if line[0] >= layout.first_row and (is_data(line[1]) or layout.is_empty_row(line[1]))
    )
    while block := list(islice(rows, _BLOCK)):
        cells = [layout.row(row) for row in split_numbered(path, block, layout.delimiter)]
        for (n, text), row in zip(block, cells, strict=True):
            count += 1
            size = count if is_data(text) else size  # blank lines at the end are no rows
            if len(row) != len(names) and is_data(text):
                expected = f"expected the {len(names)} of the line with the names"
                raise InputError(f"{path}: line {n}: {len(row)} cells, {expected}")
        cells = [row if len(row) == len(names) else [""] * len(names) for row in cells]
        for column, values in zip(columns, zip(*cells, strict=True), strict=True):
            column.append(values, [n for n, _ in block])
    units = zip(columns, layout.units, strict=True)
    return Table(path, "text", {c.name: c.column(size, unit) for c, unit in units}, layout.names)


def _sample(path: Path, file: TextIO) -> Iterator[tuple[int, str]]:
    count = letters = 0
    for n, text in _numbered(path, file):
        yield n, text
        count, letters = count + is_data(text), letters + len(text)
        if not count and letters > _LONGEST_HEADER:
            raise InputError(
                f"{path}: line {n}: no row of data in the first {_LONGEST_HEADER // 2**20} MiB, expected a "
                "shorter header"
            )
        if count == _SAMPLE or letters > _LONGEST_HEADER:
            return


def _numbered(path: Path, file: TextIO) -> Iterator[tuple[int, str]]:
    file.seek(0)
    for n, text in enumerate(iter(lambda: file.readline(_LONGEST_LINE), ""), 1):
        if len(text) == _LONGEST_LINE:
            raise InputError(f"{path}: line {n}: {_LONGEST_LINE} letters or more, expected a row of cells")
        yield n, text
