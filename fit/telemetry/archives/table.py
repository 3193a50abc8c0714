"""A table of an archive: columns by name, each a row of numbers or of texts."""

import difflib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.errors import InputError, quote
from fit.files import key as shown_key

Array = NDArray[np.float64]

BLOCK = 2**14  # samples in memory at a time


@dataclass(frozen=True)
class Column:
    """What is known of a column before it is read.

    Attributes
    ----------
    size : int or None
        Number of rows, None if the column is neither a row of numbers nor one of texts.
    unit : str or None
        As the file states it.
    reason : str
        What the column is if it is no row of numbers: "text", "an array of shape (3, 4, 5)", "an object of
        class ao". Empty for numbers.
    text : bool
        Whether its rows are texts, which `Table.texts` yields and `Table.blocks` does not.
    """

    size: int | None
    unit: str | None = None
    reason: str = ""
    text: bool = False


class Table(ABC):
    """One table of an archive.

    Attributes
    ----------
    path : Path
        The archive.
    columns : mapping of str to Column
        By name. The names of structs and groups stand before those of what they contain, joined by dots; column
        k of a matrix `out` is ``out[k]``, counted from 1.
    is_ordered : bool
        Whether the file gives its columns an order, so that a number says which one is meant.
    """

    path: Path
    columns: Mapping[str, Column]
    is_ordered: bool = True

    @abstractmethod
    def blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        """Yield columns of numbers of one length, up to `BLOCK` rows at a time; a missing sample is NaN."""

    @abstractmethod
    def texts(self, name: str) -> Iterator[list[str]]:
        """Yield a column as texts, up to `BLOCK` rows at a time; a missing one is empty.

        Raises
        ------
        InputError
            If the format cannot give the column as text.
        """

    def column(self, key: str | int) -> str:
        """Return the name of a column.

        Parameters
        ----------
        key : str or int
            Its name, its name without the unit in brackets that follows, or its number, counted from 1.

        Raises
        ------
        InputError
            If there is no such column, or several.
        """
        if isinstance(key, int):
            return self._by_number(key)
        if key in self.columns:
            return key
        alike = [name for name in self.columns if key in self._aliases(name)]
        if len(alike) == 1:
            return alike[0]
        place = f"{self.path}: column {shown_key(key)}"
        if alike:
            raise InputError(f"{place}: there are several, expected one of {_listed(alike)}")
        if f"{key}[1]" in self.columns:
            last = max(k for k in range(1, len(self.columns) + 1) if f"{key}[{k}]" in self.columns)
            raise InputError(f"{place}: a matrix, expected one of its columns, {key}[1] to {key}[{last}]")
        close = difflib.get_close_matches(key, self.columns, n=1)
        hint = f', did you mean "{close[0]}"?' if close else ""
        raise InputError(
            f"{place}: missing{hint}, expected it among the columns: {_listed(self.columns) or 'there are none'}"
        )

    def _by_number(self, number: int) -> str:
        place = f"{self.path}: column {number}"
        if not self.is_ordered:
            raise InputError(
                f"{place}: columns have no order here, expected a name; there are: {_listed(self.columns)}"
            )
        if not 1 <= number <= len(self.columns):
            raise InputError(
                f"{place}: missing, expected 1 to {len(self.columns)}: {_listed(self.columns) or 'there are none'}"
            )
        return list(self.columns)[number - 1]

    def _aliases(self, name: str) -> set[str]:
        """Return other spellings by which a column may be asked for."""
        return {name.partition(" [")[0], name.partition(" (")[0]} - {""}


def _listed(names: Sequence[str] | Mapping[str, Column]) -> str:
    text = ", ".join(name if name.isprintable() else quote(name) for name in names)
    return text if len(text) <= 200 else f"{text[:200]} ..."


def damaged(path: Path, error: Exception) -> InputError:
    """Return the error for a file that a library cannot read."""
    why = str(error).partition("\n")[0][:200]
    return InputError(f"{path}: cannot be read ({why}), expected a table of telemetry")
