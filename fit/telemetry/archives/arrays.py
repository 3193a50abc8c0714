"""Arrays of NumPy or HDF5 as a table."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fit.errors import InputError
from fit.files import key
from fit.telemetry.archives.table import BLOCK, Array, Column, Table


class Arrays(Table):
    """Arrays of NumPy or HDF5 by name; a single row or column of a matrix is a row of numbers."""

    def __init__(
        self, path: Path, arrays: Mapping[str, Any], units: Mapping[str, str | None] | None = None
    ) -> None:
        self.path, self._arrays = path, arrays
        self.columns = {
            name: Column(_length(array), (units or {}).get(name)) for name, array in arrays.items()
        }

    def blocks(self, names: Sequence[str]) -> Iterator[list[Array]]:
        size = self.columns[names[0]].size or 0
        for start in range(0, size, BLOCK):
            yield [_part(self._arrays[name], slice(start, start + BLOCK)) for name in names]

    def texts(self, name: str) -> Iterator[list[str]]:
        """Refuse: numbers are no texts."""
        raise InputError(f"{self.path}: column {key(name)}: numbers, expected texts")


def _length(array: Any) -> int | None:
    if (
        array.dtype.kind not in "iufb"
        or array.ndim == 0
        or sorted(array.shape)[:-1] != [1] * (array.ndim - 1)
    ):
        return None
    return int(max(array.shape))


def _part(array: Any, part: slice) -> Array:
    axis = int(np.argmax(array.shape))
    return np.asarray(array[tuple(part if i == axis else 0 for i in range(array.ndim))], dtype=np.float64)
