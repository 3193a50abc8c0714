"""What the results of all workflows have in common: a table, JSON, and a data frame of pandas."""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from fit.tables import Table

if TYPE_CHECKING:
    import pandas


class WorkflowResult(ABC):
    """A result that shows itself as a table."""

    @abstractmethod
    def table(self) -> Table:
        """Return what is printed."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`."""

    @abstractmethod
    def records(self) -> list[dict[str, Any]]:
        """Return the rows of `to_dataframe`; the first key is the index."""

    def to_json(self) -> str:
        """Return the result as JSON, in the schema of the command of this name."""
        return json.dumps(self.document(), indent=1, allow_nan=False)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the result as a table of pandas."""
        import pandas as pd  # slow to import

        records = self.records()
        frame = pd.DataFrame.from_records(records)
        return frame.set_index(next(iter(records[0]))) if records else frame

    def __repr__(self) -> str:
        return "\n".join(self.table().aligned())

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        return str(self.table().html())


def by_parameter(records: Iterable[Mapping[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Return the numbers of rows by their parameter, as a document of JSON has them: None if not finite."""
    return {
        row["parameter"]: {
            key: x if math.isfinite(x) else None for key, x in row.items() if key != "parameter"
        }
        for row in records
    }
