"""Text: lines of cells separated by tabs, semicolons, commas or blanks, in any encoding."""

import bz2
import codecs
import gzip
import io
import lzma
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TextIO, cast

import numpy as np

from fit.errors import InputError, shown
from fit.files import key
from fit.telemetry.archives.layout import detect_layout, is_data, number, split_numbered, unique_names
from fit.telemetry.archives.table import Array, Column, Table, batches

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
_SAMPLE = 200  # lines that show the layout


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
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
            yield Text(file, path)


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


class Text(Table):
    """A text in a file; it is read once for its layout, once for its length, and then for each block."""

    kind = "text"

    def __init__(self, file: TextIO, path: Path) -> None:
        self._file, self.path = file, path
        self._layout = detect_layout(path, list(self._sample()))
        self._names = unique_names(self._layout.names)
        self.order = self._names
        size, self._last = self._extent()
        self.columns = {
            name: Column(size, unit, "text" if text else "", text)
            for name, unit, text in zip(self._names, self._layout.units, self._layout.is_text, strict=True)
        }

    def _blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        """Yield columns of numbers."""
        for block in batches(self._lines()):
            columns = self._cells(block)
            yield [self._numbers(block, columns[self._names.index(name)], name) for name in names]

    def _texts(self, name: str) -> Iterator[list[str]]:
        """Yield the cells of a column as they are written, be they numbers or texts."""
        index = self._names.index(name)
        for block in batches(self._lines()):
            yield [cell.strip() for cell in self._cells(block)[index]]

    def _same_spelling(self, key: str) -> list[str]:
        """Return the columns that a key means, be their names unique or not."""
        written = zip(self._names, self._layout.names, strict=True)
        return [name for name, as_written in written if as_written == key] or super()._same_spelling(key)

    def _sample(self) -> Iterator[tuple[int, str]]:
        count = letters = 0
        for n, text in self._numbered():
            yield n, text
            count, letters = count + is_data(text), letters + len(text)
            if count == _SAMPLE or letters > 4 * _LONGEST_LINE:
                return

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of every line of data, blank ones of a single column among them."""
        for n, text in self._numbered():
            if n > self._last:
                return
            if n >= self._layout.first_row and (is_data(text) or self._layout.is_empty_row(text)):
                yield n, text

    def _extent(self) -> tuple[int, int]:
        """Return the number of rows, and that of the last line with data: blank ones after it are none."""
        size = last_line = empty = 0
        for n, text in self._numbered():
            if n >= self._layout.first_row and is_data(text):
                size, last_line, empty = size + empty + 1, n, 0
            elif n >= self._layout.first_row and self._layout.is_empty_row(text):
                empty += 1
        return size, last_line

    def _numbered(self) -> Iterator[tuple[int, str]]:
        self._file.seek(0)
        for n, text in enumerate(iter(lambda: self._file.readline(_LONGEST_LINE), ""), 1):
            if len(text) == _LONGEST_LINE:
                raise InputError(
                    f"{self.path}: line {n}: {_LONGEST_LINE} letters or more, expected a row of cells"
                )
            yield n, text

    def _cells(self, block: Sequence[tuple[int, str]]) -> list[tuple[str, ...]]:
        """Return the cells of lines, column by column."""
        rows = [self._layout.row(row) for row in split_numbered(self.path, block, self._layout.delimiter)]
        width = len(self._layout.names)
        for (n, _), row in zip(block, rows, strict=True):
            if len(row) != width:
                raise InputError(
                    f"{self.path}: line {n}: {len(row)} cells, expected the {width} of "
                    "the line with the names"
                )
        return list(zip(*rows, strict=True))

    def _numbers(self, block: Sequence[tuple[int, str]], cells: Sequence[str], name: str) -> Array:
        decimal = self._layout.decimal
        try:
            if decimal == "." and not any("_" in text for _, text in block):  # Python reads 1_0 as 10
                return np.array([float(cell) for cell in cells])
        except ValueError:  # an empty cell is a missing sample
            pass
        values = [number(cell, decimal) for cell in cells]
        for (n, _), cell, value in zip(block, cells, values, strict=True):
            if value is None:
                mark = "point" if decimal == "." else "comma, as others have"
                raise InputError(
                    f"{self.path}: line {n}: column {key(name)}: {shown(cell)}, expected a number with a "
                    f"decimal {mark}, or nothing"
                )
        return np.array(values, dtype=np.float64)
