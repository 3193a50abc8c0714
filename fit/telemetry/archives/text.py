"""Text: lines of cells separated by tabs, semicolons, commas or blanks, read by `numpy.loadtxt`.

Delimiter and first row are recognised; whatever a file leaves open is refused until the map states it.
"""

import bz2
import codecs
import csv
import gzip
import io
import lzma
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fit import files
from fit.errors import InputError, shown
from fit.telemetry.archives.columns import MISSING, Column, Table, clean_unit, is_unit

_OPENERS: dict[str, Any] = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
SUFFIXES = tuple(
    f"{kind}{pack}" for kind in (".csv", ".tsv", ".txt", ".dat", ".asc") for pack in ("", *_OPENERS)
)
_COMMENTS = ("#", "%")
_DELIMITERS = ("\t", ";", ",", " ")
_SAMPLE = 2000  # lines that show the layout
_TAIL = 50  # of these, the last ones show what the columns are
_FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dD]([+-]?\d+)")
_STAMP = re.compile(r"\d{4}[-/:]\d")

Line = tuple[int, str]


class Layout(files.Table, strict=True):
    """What a map states of texts in its table [text]; None for what is recognised.

    Attributes
    ----------
    delimiter : str or None
        Between cells; a blank stands for any number of them.
    decimal : str
        Between the whole and the fraction of a number.
    header : int or None
        Number of lines above the data.
    """

    delimiter: Literal[",", ";", "\t", " "] | None = None
    decimal: Literal[".", ","] = "."
    header: Annotated[int, Field(ge=0)] | None = None


def read_text(path: Path, layout: Layout) -> Table:
    """Read a text.

    Raises
    ------
    InputError, ValueError
        If rows differ in length, or it is not clear where cells or rows begin.
    """
    with _OPENERS.get(path.suffix.lower(), open)(path, "rb") as binary:
        is_utf_16 = binary.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        binary.seek(0)
        # Letters of another encoding in columns that nobody reads do no harm.
        encoding = "utf-16" if is_utf_16 else "utf-8-sig"
        with io.TextIOWrapper(binary, encoding=encoding, errors="replace") as file:
            return _read_table(path, file, layout)


def _split(line: str, delimiter: str) -> list[str]:
    text = line.strip() if delimiter == " " else line
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])]


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _is_row(line: str) -> bool:
    return not _is_comment(line) and bool(line.strip(" "))


def number(cell: str, decimal: str = ".") -> float | None:
    """Return what a cell means, NaN if a sample is missing, None if it is no number."""
    text = cell.strip()
    if decimal == ",":
        text = text.replace(".", "_").replace(",", ".")
    try:
        return None if "_" in text else float(text)  # Python reads 1_0 as 10
    except ValueError:
        if text in MISSING:
            return np.nan
        match = _FORTRAN.fullmatch(text)
        return float(f"{match[1]}e{match[2]}") if match else None


def _read_table(path: Path, file: TextIO, layout: Layout) -> Table:
    lines = enumerate((line.rstrip("\r\n") for line in file), 1)
    sample = list(islice(lines, _SAMPLE + (layout.header or 0)))
    body = [line for _, line in sample if _is_row(line)]
    end = body[-1].strip(" ") if body else ""
    recognised: Iterator[str] = (d for d in _DELIMITERS if d in end and d != layout.decimal)
    delimiter: str = layout.delimiter or next(recognised, " ")
    rows = [(n, _split(line, delimiter)) for n, line in sample if _is_row(line)]
    tail = [row for _, row in rows[1:][-_TAIL:] or rows]
    width = Counter(map(len, tail)).most_common(1)[0][0] if tail else 0
    tail = [row for row in tail if len(row) >= width]
    is_text = [_is_text([row[i] for row in tail], layout.decimal) for i in range(width)]
    start = _first_row(path, rows, is_text, layout)
    if not rows or rows[-1][0] < start:  # names alone
        is_text = [False] * width
    names, units = _names(sample, start, delimiter, is_text)
    if layout.delimiter is None and delimiter == "," and width == 2 and names == ["1", "2"]:
        raise InputError(
            f"{path}: line {start}: the comma may be a decimal mark or separate two columns, expected names "
            'above the columns, or delimiter = "," in [text] of the map'
        )
    if width == 1 and layout.header is None:  # a blank line above the first number may be a sample
        start = max((n for n, line in sample if n < start and line.strip(" ")), default=0) + 1
    content = _data(path, chain((line for line in sample if line[0] >= start), lines), width)
    faults: dict[int, str] = {}
    rows_of_numbers = np.empty(0, dtype=[(str(i), float) for i in range(width)])
    if (row := next(content, None)) is not None:
        if width == 0:
            raise InputError(
                f"{path}: no data in its first {_SAMPLE} lines, expected header = the number of lines above "
                "the data in [text] of the map"
            )
        rows_of_numbers = np.loadtxt(
            chain([row], content),
            dtype=[(str(i), object if text else float) for i, text in enumerate(is_text)],
            delimiter=None if delimiter == " " else delimiter,
            converters={
                i: str.strip if text else partial(_converted, layout.decimal, faults, i)
                for i, text in enumerate(is_text)
            },
            comments=None,
            quotechar='"',
            ndmin=1,
        )
    columns = {
        name: Column(partial(_column, rows_of_numbers, faults, i), unit)
        for i, (name, unit) in enumerate(zip(names, units, strict=True))
    }
    return Table(path, columns, has_order=True)


def _data(path: Path, lines: Iterator[Line], width: int) -> Iterator[str]:
    """Yield the rows."""
    blank = 0
    for n, line in lines:
        if "\0" in line:  # at which NumPy ends the line
            raise InputError(f"{path}: line {n}: a zero byte, expected text")
        if blank and width == 1 and _is_row(line):
            expected = "expected nan for a missing sample"
            raise InputError(f"{path}: line {blank}: blank in a single column, {expected}")
        if _is_row(line):
            yield line
        elif not _is_comment(line):
            blank = blank or n


def _converted(decimal: str, faults: dict[int, str], i: int, cell: str) -> float:
    """Return the number of a cell; the first of a column that is none is refused when that is used."""
    value = number(cell, decimal)
    if value is None:
        faults.setdefault(i, cell)
    return np.nan if value is None else value


def _column(rows: NDArray[Any], faults: dict[int, str], i: int) -> NDArray[Any]:
    if i in faults:
        raise ValueError(
            f'{shown(faults[i])} is no number; decimal commas: decimal = "," in [text] of the map'
        )
    return np.asarray(rows[str(i)])


def _is_text(cells: Sequence[str], decimal: str) -> bool:
    stated = [cell for cell in cells if cell not in MISSING]
    return 2 * sum(number(cell, decimal) is not None for cell in stated) < len(stated)


def _first_row(
    path: Path, rows: Sequence[tuple[int, list[str]]], is_text: Sequence[bool], layout: Layout
) -> int:
    """Return the number of the first line of data."""
    if layout.header is not None:
        return layout.header + 1
    for i, (n, row) in enumerate(rows):
        cells = [cell for cell, text in zip(row, is_text, strict=False) if not text]
        if all(is_text):
            begins = any(map(_STAMP.match, row))
        else:
            numbers = [number(cell, layout.decimal) for cell in cells]
            begins = len(row) == len(is_text) and None not in numbers
        if not begins:
            continue
        counted = [c for c in cells if c]
        if i == 0 and len(row) > 2 and counted in ([str(k + o) for k in range(len(counted))] for o in (0, 1)):
            raise InputError(
                f"{path}: line {n}: {shown(','.join(row))} may be names or data, expected header = {n} or "
                f"{n - 1} in [text] of the map"
            )
        return n
    return rows[-1][0] + 1 if rows else 1


def _names(
    sample: Sequence[Line], start: int, delimiter: str, is_text: Sequence[bool]
) -> tuple[list[str], list[str | None]]:
    """Return names and units of columns, which stand above the data or in the comments there."""
    header = [line for n, line in sample if n < start and line.strip(" ")]
    comments = [line.lstrip("#% \t") for line in header if _is_comment(line)]
    titles = [line for line in header if not _is_comment(line)]
    width, candidates = len(is_text), list[list[str]]()
    for lines, separator in ((titles, delimiter), (comments, delimiter), (comments, " ")):
        split = [[line.strip(' "')] if width == 1 else _split(line, separator) for line in lines]
        candidates = candidates or [row for row in split if len(row) == width]
    units = [""] * width
    if len(candidates) > 1:
        cells = [cell for cell, text in zip(candidates[-1], is_text, strict=True) if cell and not text]
        if all(clean_unit(cell) is None or is_unit(clean_unit(cell) or "") for cell in cells):
            units = candidates.pop()
    names = candidates[-1] if candidates else [""] * width
    counts = Counter(names)
    numbers = [f"column {i}" if str(i) in counts else str(i) for i in range(1, width + 1)]
    unique = [n if n and counts[n] == 1 else number for n, number in zip(names, numbers, strict=True)]
    return unique, [clean_unit(unit) for unit in units]
