"""The layout of a text: its delimiter, its decimal mark, its names and units, and where its numbers begin."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path

from fit.errors import InputError, shown
from fit.telemetry.archives.table import MISSING, clean_unit, is_unit, split_unit

COMMENTS = ("#", "%")
_DELIMITERS = ("\t", ";", ",", " ")
_TAIL = 50  # lines that show what the columns are
_FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dD]([+-]?\d+)|([+-]?\d*\.\d*)([+-]\d{3})")
_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eEdD][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+")
_STAMP = re.compile(r"(?:\d{1,4}[-/:.]\d{1,3}(?![^-/:. TZ])|\d{8}T|\d{1,2}[- ][A-Za-z]{3})[^,;\t]*")


@dataclass(frozen=True)
class Layout:
    """How a text is to be read.

    Attributes
    ----------
    delimiter, decimal : str
        Between cells; between the whole and the fraction of a number.
    names : list of str
        Of the columns, as they are written; empty where there is none.
    units : list of str or None
        Of the columns.
    is_text : list of bool
        Which columns are texts.
    first_row : int
        Number of the first line of data.
    """

    delimiter: str
    decimal: str
    names: list[str]
    units: list[str | None]
    is_text: list[bool]
    first_row: int

    def row(self, cells: list[str]) -> list[str]:
        """Return the cells of a line without an empty one after the last delimiter."""
        if not cells:  # a blank line
            return [""]
        return cells[:-1] if len(cells) == len(self.names) + 1 and not cells[-1].strip() else cells

    def is_empty_row(self, line: str) -> bool:
        """Return whether a blank line among the data is a row of which all samples are missing."""
        return not line.strip() and (len(self.names) == 1 or (self.delimiter == "\t" and "\t" in line))


def is_data(line: str) -> bool:
    """Return whether a line is neither blank nor a comment."""
    return bool(line.strip()) and not line.lstrip().startswith(COMMENTS)


def split(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Return the cells of lines."""
    texts = (line.strip() for line in lines) if delimiter == " " else lines
    return list(csv.reader(texts, delimiter=delimiter, skipinitialspace=True))


def split_numbered(path: Path, lines: Sequence[tuple[int, str]], delimiter: str) -> list[list[str]]:
    """Return the cells of numbered lines.

    Raises
    ------
    InputError
        If a cell in quotes goes over several lines.
    """
    rows = split([text for _, text in lines], delimiter)
    if len(rows) != len(lines):
        n = next((n for n, text in lines if text.count('"') % 2), lines[0][0])
        raise InputError(f"{path}: line {n}: a quote without its end on this line, expected cells")
    return rows


def number(cell: str, decimal: str = ".") -> float | None:
    """Return what a cell means, NaN if a sample is missing, None if it is no number."""
    text = cell.strip()
    if text in MISSING:
        return float("nan")
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if match := _FORTRAN.fullmatch(text):
        text = f"{match[1] or match[3]}e{match[2] or match[4]}"
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def detect_layout(path: Path, sample: Sequence[tuple[int, str]]) -> Layout:
    """Find out the layout of a text from its first lines, numbered.

    Raises
    ------
    InputError
        If it is no text, or the decimal mark or the first row is ambiguous.
    """
    lines = [(n, text) for n, text in sample if is_data(text)]
    if not lines:
        return Layout(",", ".", [], [], [], 1)
    tail = [text for _, text in lines[1:][-_TAIL:] or lines]
    delimiter = max(_DELIMITERS, key=lambda d: (_likelihood(tail, d), -_DELIMITERS.index(d)))
    rows = split_numbered(path, lines, delimiter)
    last_rows = rows[-len(tail) :]
    width = Counter(map(len, last_rows)).most_common(1)[0][0]
    last_rows = [row for row in last_rows if len(row) == width]
    if width > 1 and not any(row[-1].strip() for row in last_rows):
        named = len(rows[0]) == width and rows[0][-1].strip()
        width -= not named
    for n, text in lines:
        if "\0" in text:
            raise InputError(f"{path}: line {n}: a zero byte, expected text")
    is_text = [_is_text([row[i] for row in last_rows], delimiter) for i in range(width)]
    head = next((i for i, row in enumerate(rows) if _begins(rows, i, is_text, delimiter)), len(rows))
    first_row = lines[head][0] if head < len(lines) else lines[-1][0] + 1
    is_text = is_text if head < len(lines) else [False] * width
    comments = [t.lstrip("#% \t") for n, t in sample if n < first_row and t.strip() and not is_data(t)]
    head_rows = (
        [[" ".join(row)] for row in rows[:head]] if width == 1 else rows[:head]
    )  # a name with its unit
    names, units = _names(head_rows, comments, delimiter, is_text)
    if width == 2 and delimiter == ",":
        _check_commas(path, lines[head:], lines[:head], comments)
    decimal = _decimal(path, lines[head:], rows[head:], delimiter)
    layout = Layout(delimiter, decimal, names, units, is_text, first_row)
    preceding = reversed([(n, text) for n, text in sample if n < first_row])
    empty = [n for n, _ in takewhile(lambda line: layout.is_empty_row(line[1]), preceding)]
    if empty and width == 1:
        raise InputError(
            f"{path}: line {empty[-1]}: blank above the first number of a single column, which may be a "
            "missing sample, expected nan if it is one, or no blank line"
        )
    return replace(layout, first_row=min([first_row, *empty]))


def _likelihood(lines: Sequence[str], delimiter: str) -> float:
    """Return the share of numbers and times among the cells that a delimiter would make."""
    if delimiter != " " and not any(delimiter in line for line in lines):
        return -1.0
    cells = [cell.strip() for row in split(lines, delimiter) for cell in row if cell.strip()]
    return sum(_is_number(cell, delimiter) or _is_stamp(cell) for cell in cells) / max(len(cells), 1)


def _is_number(cell: str, delimiter: str) -> bool:
    """Return whether a cell is a number, or a missing one; a comma may be a decimal mark elsewhere."""
    return number(cell) is not None or (delimiter != "," and _COMMA.fullmatch(cell.strip()) is not None)


def _is_stamp(cell: str) -> bool:
    """Return whether a cell looks like a time rather than a name."""
    return number(cell) is None and _STAMP.fullmatch(cell.strip()) is not None


def _is_text(cells: Sequence[str], delimiter: str) -> bool:
    stated = [cell for cell in cells if cell.strip() not in MISSING]
    return 2 * sum(_is_number(cell, delimiter) for cell in stated) < len(stated)


def _begins(rows: Sequence[Sequence[str]], index: int, is_text: Sequence[bool], delimiter: str) -> bool:
    """Return whether a row is data, not names or units."""
    row = rows[index]
    if all(is_text):
        return any(map(_is_stamp, row)) and len(row) == len(is_text)
    cells = [cell.strip() for cell, text in zip(row, is_text, strict=False) if not text]
    stated = [cell for cell in cells if cell not in MISSING]
    numbers = [cell for cell in stated if _is_number(cell, delimiter)]
    if len(row) not in (len(is_text), len(is_text) + 1) or len(numbers) < len(stated):
        # Units may be 1, and names small numbers, each once.
        counts = index == 0 and len(set(numbers)) == len(numbers)
        small = all(
            cell == "1" or (counts and cell.isdecimal() and int(cell) <= len(row)) for cell in numbers
        )
        return not small
    return not _counts(row) or len(rows) == index + 1 or _counts(rows[index + 1])


def _counts(row: Sequence[str]) -> bool:
    """Return whether cells count the columns, as pandas names them where they have no names."""
    cells = [cell.strip() for cell in row]
    cells = cells[not cells[0] :]
    return len(row) > 2 and cells in ([str(i + k) for i in range(len(cells))] for k in (0, 1))


def _names(
    head: Sequence[list[str]], comments: Sequence[str], delimiter: str, is_text: Sequence[bool]
) -> tuple[list[str], list[str | None]]:
    """Return the names and units that stand above the data, or in the comments there."""
    width = len(is_text)
    candidates = [row for row in map(_trimmed, head) if len(row) == width]
    for candidate in (delimiter, *_DELIMITERS):
        candidates = candidates or [
            row for row in map(_trimmed, split(comments, candidate)) if len(row) == width
        ]
    stated = [""] * width
    if len(candidates) > 1 and _are_units(candidates[-2], candidates[-1], is_text):
        stated = [cell.strip() for cell in candidates.pop()]
    names = [cell.strip() for cell in candidates[-1]] if candidates else [""] * width
    return names, [clean_unit(cell) or split_unit(name)[1] for cell, name in zip(stated, names, strict=True)]


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names of columns with the number, counted from 1, in the place of none or of a repeated one."""
    counts = Counter(names)
    numbers = (f"column {i}" if str(i) in counts else str(i) for i in range(1, len(names) + 1))
    return [
        name if name and counts[name] == 1 else number for name, number in zip(names, numbers, strict=True)
    ]


def _trimmed(row: list[str]) -> list[str]:
    return row[:-1] if len(row) > 1 and not row[-1].strip() else row


def _are_units(names: Sequence[str], row: Sequence[str], is_text: Sequence[bool]) -> bool:
    """Return whether a line below the names is that of the units of the numbers."""
    n_units = sum(map(is_unit, names))
    cells = [cell.strip() for cell, text in zip(row, is_text, strict=True) if cell.strip() and not text]
    known = sum(clean_unit(cell) is None or is_unit(cell) for cell in cells)
    in_brackets = any(cell[0] + cell[-1] in ("[]", "()") for cell in cells)
    return in_brackets or known == len(cells) or (2 * known >= len(cells) and known > n_units)


def _check_commas(
    path: Path, data: Sequence[tuple[int, str]], head: Sequence[tuple[int, str]], comments: Sequence[str]
) -> None:
    """Refuse lines that are two integers each, or else one number with a decimal comma.

    Names of two columns above them, or in a comment, say which.
    """
    if not data or not all(_COMMA.fullmatch(text.strip()) for _, text in data):
        return
    names = split([text for _, text in head], ",")
    names += [
        row for row in split(comments, ",") if not any(" " in split_unit(cell.strip())[0] for cell in row)
    ]
    if not any(len(row) == 2 and all(cell.strip() for cell in row) for row in map(_trimmed, names)):
        n, line = data[0]
        raise InputError(
            f"{path}: line {n}: {shown(line.strip())}, the comma may be a decimal mark or separate two "
            "columns, expected numbers with a decimal point, or the names of two columns in the line above"
        )


def _decimal(path: Path, lines: Sequence[tuple[int, str]], rows: Sequence[list[str]], delimiter: str) -> str:
    """Return the decimal mark of the numbers."""
    if delimiter == ",":
        return "."
    cells = [(n, cell.strip()) for (n, _), row in zip(lines, rows, strict=True) for cell in row]
    commas = [(n, cell) for n, cell in cells if _COMMA.fullmatch(cell)]
    points = any("." in cell for _, cell in cells if number(cell) is not None)
    if not commas:
        return "."
    if points or all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        n, cell = commas[0]
        raise InputError(
            f"{path}: line {n}: {shown(cell)}, the comma may be a decimal mark or separate thousands, "
            "expected numbers with a decimal point"
        )
    return ","
