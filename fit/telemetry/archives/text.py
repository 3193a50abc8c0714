"""Text: lines of cells separated by tabs, semicolons, commas or blanks."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from fit.errors import InputError
from fit.telemetry.archives.table import BLOCK, Array, Column, Table

SUFFIXES = (".csv", ".tsv", ".txt", ".dat")
_LONGEST_LINE = 2**20  # letters


@contextmanager
def opened(path: Path, table: str | int | None) -> Iterator[Table]:
    if table is not None:
        raise InputError(f"{path}: no table {table!r}, expected none to be named in a file of one table")
    # Latin letters in columns that nobody reads do no harm.
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        yield Text(file, path)


class Text(Table):
    """Lines of cells separated by tabs, semicolons, commas or blanks, below a line with the names."""

    def __init__(self, file: TextIO, path: Path) -> None:
        self._file, self.path = file, path
        self._first, comment, line = 1, "", ""
        for number, text in self._numbered():
            if _is_data(text):
                self._first, line = number, text
                break
            comment = text.lstrip("# ") if text.strip() else comment
        self._delimiter = next((d for d in "\t;," if d in line), " ")
        cells = next(self._rows([line]), [])
        if all(map(_is_number, cells)):  # then the names stand in the last comment
            cells = next(self._rows([comment]), [])
        else:
            self._first += 1
        self._names = [cell.strip() for cell in cells]
        size = sum(1 for _ in self._lines())
        self.columns = {name: Column(size) for name in self._names}
        for name in self.columns:
            if self._names.count(name) > 1:
                raise InputError(f"{path}: column {name}: there are several, expected one of each name")

    def blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        lines = self._lines()
        while block := list(islice(lines, BLOCK)):
            rows = list(self._rows([text for _, text in block]))
            for (number, _), row in zip(block, rows, strict=False):
                if len(row) != len(self._names):
                    raise InputError(
                        f"{self.path}: line {number}: {len(row)} cells, expected the {len(self._names)} of "
                        "the line with the names"
                    )
            columns = list(zip(*rows, strict=True))
            yield [self._numbers(block, columns[self._names.index(name)], name) for name in names]

    def texts(self, name: str) -> Iterator[list[str]]:
        """Yield the cells of a column, as they are written."""
        at, lines = list(self.columns).index(name), self._lines()
        while block := list(islice(lines, BLOCK)):
            yield [row[at].strip() for row in self._rows([text for _, text in block])]

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of every line of data."""
        numbered = self._numbered()
        return ((number, text) for number, text in numbered if number >= self._first and _is_data(text))

    def _numbered(self) -> Iterator[tuple[int, str]]:
        self._file.seek(0)
        for number, text in enumerate(iter(lambda: self._file.readline(_LONGEST_LINE), ""), 1):
            if len(text) == _LONGEST_LINE:
                raise InputError(
                    f"{self.path}: line {number}: {_LONGEST_LINE} letters or more, expected a row of cells"
                )
            yield number, text

    def _rows(self, lines: Sequence[str]) -> Iterator[list[str]]:
        blank = self._delimiter == " "
        texts = (text.strip() if blank else text for text in lines)
        return csv.reader(texts, delimiter=self._delimiter, skipinitialspace=True)

    def _numbers(self, block: Sequence[tuple[int, str]], cells: Sequence[str], name: str) -> Array:
        try:
            return np.array([float(cell) for cell in cells])
        except ValueError:  # an empty cell is a missing sample
            for (number, _), cell in zip(block, cells, strict=True):
                if not _is_number(cell):
                    raise InputError(
                        f"{self.path}: line {number}: column {name}: {cell!r}, expected a number with a "
                        "decimal point, or nothing"
                    ) from None
            return np.array([float(cell) if cell.strip() else np.nan for cell in cells])


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip() or "nan")
    except ValueError:
        return False
    return True
