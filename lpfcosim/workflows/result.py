"""What the results of all workflows have in common: rows, from which table, JSON and data frame follow."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

from fit.errors import shown
from fit.files import closest_match
from fit.tables import Table
from lpfcosim.errors import InputError

if TYPE_CHECKING:
    import pandas

T = TypeVar("T")
Row: TypeAlias = dict[str, Any]
Columns: TypeAlias = Mapping[str, Callable[[Row], str]]


class Result(ABC, Generic[T]):
    """A result that shows itself as a table; index it by a name.

    Attributes
    ----------
    noun : str
        What the names are names of.
    columns : mapping of str to callable
        Text of a row in each column of the table, by its heading. A column without any text is left out.
    """

    noun: ClassVar[str] = "parameter"
    columns: ClassVar[Columns]

    @property
    @abstractmethod
    def entries(self) -> Mapping[str, T]:
        """What each name stands for."""

    @abstractmethod
    def rows(self) -> list[Row]:
        """Return the rows of `to_dataframe`: SI, NaN where there is no number; the first key is the index."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences below the tables."""
        return ()

    def __getitem__(self, name: str) -> T:
        entries = self.entries
        if str(name) not in entries:
            raise InputError(f"no {self.noun} {shown(name)}{closest_match(str(name), entries)}")
        return entries[str(name)]

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def table(self) -> Table:
        """Return a table of the rows."""
        rows = (tuple(text(row) for text in self.columns.values()) for row in self.rows())
        return Table(tuple(self.columns), tuple(rows)).filled()

    def tables(self) -> list[Table]:
        """Return all that is printed."""
        return [self.table()]

    def to_json(self) -> str:
        """Return the result as JSON, in the schema of the command of this name."""
        return json.dumps(self.document(), indent=1, allow_nan=False)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the result as a table of pandas."""
        import pandas as pd  # slow to import

        frame = pd.DataFrame.from_records(self.rows())
        return frame.set_index(frame.columns[0]) if len(frame) else frame

    def __repr__(self) -> str:
        tables = ("\n".join(table.aligned()) for table in self.tables())
        return "\n\n".join((*tables, *(["\n".join(self.notes)] if self.notes else ())))

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        return str(self.table().html())


def finite(row: Row) -> Row:
    """Return a row as a document of JSON has it: None instead of numbers that are not finite."""
    return {key: None if isinstance(x, float) and not math.isfinite(x) else x for key, x in row.items()}


def by_name(rows: Iterable[Row]) -> dict[str, Row]:
    """Return rows for JSON by their first value, which is their name."""
    documents = (finite(row) for row in rows)
    return {row.pop(next(iter(row))): row for row in documents}
